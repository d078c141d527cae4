import numpy as np
import pytest
from conftest import read_log

from drake_pregrasp import (
    MeasurementFaults,
    ScenarioError,
    load_scenario,
    make_diagram,
    run,
    shipped_scenarios,
)
from drake_pregrasp.config.sensor_config import SensorConfig

NAMES = [name for name, (file, _) in shipped_scenarios().items() if file.stem == "faults"]


def test_by_default_there_are_no_faults():
    assert not SensorConfig().faults.are_any


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_fault_is_on_from_6_to_12_of_20_s(name):
    scenario = load_scenario(name)
    faults = scenario.sensor.faults
    assert faults.are_any
    assert (faults.start, faults.end, scenario.simulation_duration) == (6.0, 12.0, 20.0)
    assert [k for k in range(400) if faults.act_at(k, 0.05)] == list(range(120, 240))


def test_each_shipped_fault_is_another_and_everything_has_them_all():
    default = vars(MeasurementFaults())
    changed = {
        name: {
            key
            for key, value in vars(load_scenario(name).sensor.faults).items()
            if value != default[key] and key not in ("start", "end")
        }
        for name in NAMES
    }
    everything = changed.pop("fault_everything")
    assert len({frozenset(keys) for keys in changed.values()}) == len(NAMES) - 1
    assert set.union(*changed.values()) == everything


def test_a_run_has_the_faults_of_its_scenario_and_its_seed(tmp_path):
    text = "{simulation_duration: 7.0, random_seed: 5}"
    faulty = load_scenario("fault_delay", text=text)
    sound = load_scenario("fault_delay", text=text)
    sound.sensor.faults = MeasurementFaults()
    logs = []
    for name, scenario in (("faulty", faulty), ("sound", sound)):
        result = run(scenario, name=name, out=tmp_path, recording=False)
        logs.append(read_log(result.folder / "log.csv"))
    differs = np.any(
        [logs[0][key] != logs[1][key] for key in logs[0] if key.endswith("_wo_estimated")], axis=0
    )
    assert not np.any(differs[:120])
    assert np.any(differs[120:])
    sensor = make_diagram(faulty, faulty.make_surface()).GetSubsystemByName("pose_sensor")
    assert sensor.CreateDefaultContext().get_numeric_parameter(0)[0] == 5


@pytest.mark.parametrize(
    ("faults", "key", "problem"),
    [
        ("start: 3, end: 2", "start", "3.0 must be less than end, which is 2.0"),
        ("start: 5.01, end: 5.02", "start", "5.01 must be a tick before end, 5.02"),
        ("orientation_bias: [3, 3, 0]", "orientation_bias", "turns by 4.243 rad; at most pi"),
        ("position_bias: [3, 3]", "position_bias", "must be a list of exactly 3 elements"),
        ("degrees_of_freedom: 0.5", "degrees_of_freedom", "0.5 must be 0, for normal noise, or"),
        ("nan_probability: 2", "nan_probability", "2 must be a number at least 0 and at most 1"),
        ("delay: 60", "delay", "it is 60 s with jitter; at most 1000 ticks, 50 s"),
        ("out_of_order: true", "out_of_order", "with a jitter of 0.0 s none overtakes"),
        ("sample_period: 0.01", "sample_period", "must be 0 or at least the planning period"),
        ("end: .inf", "end", "inf must be a number above 0 and at most"),
    ],
)
def test_what_is_unusable_is_named_by_its_key(faults, key, problem):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("a_base", text=f"{{sensor: {{faults: {{{faults}}}}}}}")
    assert f"sensor.faults.{key}: " in str(caught.value)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)
