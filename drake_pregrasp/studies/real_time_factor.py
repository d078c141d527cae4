"""How many times faster than real time the base case simulates: `python -m` this module."""

import argparse
import statistics
import tempfile

from drake_pregrasp.simulation.run import run
from drake_pregrasp.simulation.scenario_file import load_scenario


def real_time_factors(repeats: int, duration: float) -> dict[bool, list[float]]:
    """Runs the base case `repeats` times with and without a recording, in turn.

    Args:
        repeats: Runs of each kind.
        duration: Seconds to simulate in each.

    Returns:
        The runs' real-time factors, by whether they were recorded.
    """
    scenario = load_scenario("a_base")
    scenario.simulation_duration = duration
    factors: dict[bool, list[float]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(repeats):
            for recording in factors:
                result = run(scenario, name="benchmark", out=folder, recording=recording)
                factors[recording].append(result.summary["real_time_factor"])
    return factors


def main() -> None:
    """Prints medians and ranges."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--duration", type=float, default=60.0, metavar="SECONDS")
    options = parser.parse_args()
    factors = real_time_factors(options.repeats, options.duration)
    print(f"base case, {options.duration:g} s simulated, {options.repeats} runs of each kind")
    for recording, values in factors.items():
        kind = "with a recording at 20 Hz" if recording else "without a recording"
        low, middle, high = min(values), statistics.median(values), max(values)
        print(f"{kind:27}{middle:6.1f} x real time (from {low:.1f} to {high:.1f})")


if __name__ == "__main__":
    main()
