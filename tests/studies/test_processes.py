"""Computations in several processes."""

import os
from collections import Counter
from concurrent.futures.process import BrokenProcessPool

from drake_pregrasp.studies import processes


def process_of(job):
    return job, os.getpid()


def test_results_are_in_their_order_and_processes_are_renewed(monkeypatch):
    monkeypatch.setattr(processes, "_JOBS_A_PROCESS", 2)
    jobs = list(range(5))
    ended = {index: f.result() for index, f in processes.as_they_end(process_of, jobs, processes=1)}
    assert [ended[index][0] for index in range(5)] == jobs
    makers = [ended[index][1] for index in range(5)]
    assert makers[0] == makers[1] != makers[2] == makers[3] != makers[4]
    assert [job for job, _ in processes.in_processes(process_of, jobs)] == jobs


def die_at_first(job):
    """Ends its process unless it, or one before it, has left a note that it was there."""
    number, deadly, folder = job
    times = len(list(folder.glob(f"{number}_*")))
    (folder / f"{number}_{times}").touch()
    if number in deadly and times < deadly[number]:
        os._exit(9)
    return number


def test_a_process_that_dies_costs_no_result(tmp_path):
    jobs = [(number, {1: 1, 4: 1}, tmp_path) for number in range(7)]
    ended = list(processes.as_they_end(die_at_first, jobs, processes=2, attempts=3))
    assert sorted((index, future.result()) for index, future in ended) == [(k, k) for k in range(7)]


def test_only_the_job_that_always_ends_its_process_is_given_up(tmp_path):
    jobs = [(number, {2: 99}, tmp_path) for number in range(6)]
    ended = dict(processes.as_they_end(die_at_first, jobs, processes=2, attempts=3))
    assert sorted(ended) == list(range(6))
    failed = [index for index, f in ended.items() if isinstance(f.exception(), BrokenProcessPool)]
    assert failed == [2]
    begun = Counter(file.name.split("_")[0] for file in tmp_path.iterdir())
    assert begun["2"] == 3
