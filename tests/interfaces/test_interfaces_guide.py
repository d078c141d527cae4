"""The page on interfaces is followed as it stands; ROS 2 itself is replaced by stand-ins."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml
from pages import DOCS, blocks, executed

from drake_pregrasp import Scenario
from drake_pregrasp.estimation.recorded_poses import MAX_ROWS
from drake_pregrasp.interfaces.mcap_log import McapLog
from drake_pregrasp.interfaces.pose_files import _KINDS, MAX_BAG_BYTES
from drake_pregrasp.simulation.schema_check import check_mapping

PAGE = "interfaces.md"
(NODE,) = blocks(PAGE, "python")
LATENCY = (DOCS / "interfaces" / "latency.py").read_text(encoding="utf-8")


class Message(SimpleNamespace):
    """A message of any kind: fields that are not given are empty messages."""

    def __getattr__(self, name):
        self.__dict__[name] = Message()
        return self.__dict__[name]


class Node:
    def __init__(self, name):
        self.published, self.callbacks = [], {}

    def create_publisher(self, kind, topic, depth):
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, kind, topic, callback, depth):
        self.callbacks[topic] = callback

    def create_timer(self, period, callback):
        self.callbacks[period] = callback

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Message))


def test_the_node_publishes_goals_on_the_object_that_it_sees(monkeypatch):
    messages = ModuleType("geometry_msgs.msg")
    messages.__dict__.update(dict.fromkeys(("Point", "Pose", "PoseArray", "PoseStamped"), Message))
    node = ModuleType("rclpy.node")
    node.Node = Node
    rclpy, package = ModuleType("rclpy"), ModuleType("geometry_msgs")
    for module in (rclpy, node, package, messages):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    node = executed(PAGE, NODE)["PregraspNode"]()
    pose = Message(position=Message(x=1.0, y=0.0, z=0.5), orientation=Message(w=1, x=0, y=0, z=0))
    for _ in range(3):
        node.callbacks["/object_pose"](Message(pose=pose))
        node.callbacks[0.02]()
    goals = [[getattr(p.position, axis) for axis in "xyz"] for p in node.published[-1].poses]
    assert np.shape(goals) == (3, 3)
    assert np.all(np.abs(np.array(goals) - [1.0, 0.0, 0.5]) <= np.array([0.03, 0.03, 0.06]) + 1e-3)


@pytest.mark.slow
def test_the_latency_of_a_loop_is_measured():
    code = LATENCY.replace("0.01, 10.0, 1.0", "0.01, 2.0, 0.5")
    waits = executed(PAGE, code)["waits"]
    assert len(waits) == 149
    assert np.median(waits) > 0.1  # Milliseconds: a command cannot come before its pose is used.


def test_settings_and_limits_are_those_of_the_code():
    text = (DOCS / PAGE).read_text(encoding="utf-8")
    (scenario,) = yaml.safe_load(
        blocks(PAGE, "yaml")[0].replace("!Box", "").replace("!PoseStream", "")
    ).values()
    assert scenario.pop("motion").keys() == {"file", "topic", "frame"}
    check_mapping(PAGE, "", scenario, Scenario)
    for kind in _KINDS:
        assert f"`{kind}`" in text
    assert f"{MAX_BAG_BYTES / 1e6:g} MB" in text
    assert f"{MAX_ROWS:,} poses" in text
    for topic in ("/tf", "/object", "/goals", "/regions", "/measures"):
        assert f"| `{topic}` |" in text
        assert f"`{topic}`" in str(McapLog.__doc__)
