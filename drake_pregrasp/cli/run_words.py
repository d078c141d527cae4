"""What the command says at the end of a run."""

from collections.abc import Mapping
from typing import Any

from drake_pregrasp.simulation.run import RunResult
from drake_pregrasp.simulation.summary import MEASURES


def print_result(result: RunResult, *, recorded: bool) -> None:
    """Prints a run's measures, its speed, what has gone wrong, and where its files are.

    Args:
        result: Of the run.
        recorded: Whether there is a recording.
    """
    summary = result.summary
    for title, phase in (("static", "static"), ("best after", "max")):
        values = summary[phase]
        if values["q_msv"] is not None:
            shown = "   ".join(f"{m.upper()} {values[m]:.4f}" for m in MEASURES)
            print(f"{title:12}{shown}")
    print(
        f"speed       {summary['real_time_factor']:.1f} x real time,"
        f" planning tick {summary['tick_time_p50_ms']:.2f} ms (median)"
    )
    if "grasp" in summary:
        print(f"grasp       {_grasp_in_words(summary['grasp'])}")
    if summary["deadline_overruns"]:
        print(
            f"late        {summary['deadline_overruns']} of {summary['ticks']} ticks took longer"
            " than planner.period"
        )
    for contact, reason in summary["inactive_contacts"].items():
        print(f"at the end contact {contact} has no place, and doesn't count: {reason}")
    if not result.completed:
        print(
            f"interrupted at {summary['simulated_seconds']:g} s:"
            f" the log up to that tick is in {result.folder / 'log.csv'}"
        )
    if recorded:
        print(f"recording in {result.folder / 'recording.html'}: open it in a browser")
    else:
        print(f"results in {result.folder}")


def _grasp_in_words(grasp: Mapping[str, Any]) -> str:
    words = [f"at the end: {grasp['phase']}"]
    if grasp["gave_up"] is not None:
        words.append(f"gave up because {grasp['gave_up']}")
    for key, text in (
        ("tracking_error_mean_mm", "fingertips {:.3f} mm off their goals"),
        ("closing_motion_mm", "object moved {:.3f} mm in closing"),
        ("lift_height_mm", "lifted {:.1f} mm"),
        ("slip_lift_mm", "slip {:.2f} mm in the lift"),
        ("slip_hold_mm", "{:.2f} mm in the hold"),
    ):
        if grasp[key] is not None:
            words.append(text.format(grasp[key]))
    return ", ".join(words)
