import numpy as np
import pytest
from conftest import read_log

from drake_pregrasp import MeasurementFaults, load_scenario, make_diagram, run, shipped_scenarios
from drake_pregrasp.config.sensor_config import SensorConfig

NAMES = [name for name, (file, _) in shipped_scenarios().items() if file.stem == "faults"]


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_fault_is_on_from_6_to_12_of_20_s(name):
    assert not SensorConfig().faults.are_any
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


@pytest.mark.slow
def test_a_run_has_the_faults_of_its_scenario_and_its_seed(tmp_path):
    text = "{simulation_duration: 7.0, random_seed: 5}"
    faulty = load_scenario("fault_delay", text=text)
    sound = load_scenario("fault_delay", text=text)
    sound.sensor.faults = MeasurementFaults()
    results = [run(s, name=str(id(s)), out=tmp_path, recording=False) for s in (faulty, sound)]
    logs = [read_log(result.folder / "log.csv") for result in results]
    keys = [key for key in logs[0] if key.endswith("_wo_estimated")]
    differs = np.any([logs[0][key] != logs[1][key] for key in keys], axis=0)
    assert not np.any(differs[:120])
    assert np.any(differs[120:])
    sensor = make_diagram(faulty).GetSubsystemByName("pose_sensor")
    assert sensor.CreateDefaultContext().get_numeric_parameter(0)[0] == 5
