"""Computations in several processes."""

import os

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
