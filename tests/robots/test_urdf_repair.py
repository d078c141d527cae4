"""Mends of a URDF, one test for each."""

from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drake_pregrasp.errors import InvalidArgumentError, first_line
from drake_pregrasp.robots.robot_meshes import convert_mesh
from drake_pregrasp.robots.urdf_repair import drop_from, repair_inertias

ROBOT = """
<robot name="tree">
  <link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <joint name="ab" type="revolute"><parent link="a"/><child link="b"/>
    <limit effort="15" lower="-1" upper="1" velocity="1"/></joint>
  <joint name="bc" type="fixed"><parent link="b"/><child link="c"/></joint>
  <joint name="ad" type="revolute"><parent link="a"/><child link="d"/>
    <limit effort="15" lower="-1" upper="1" velocity="1"/></joint>
</robot>
"""
moments = st.floats(1e-6, 1.0)


def names(robot, tag):
    return [element.get("name") for element in robot.findall(tag)]


def test_what_hangs_on_a_dropped_link_goes_with_it():
    robot = ElementTree.fromstring(ROBOT)
    drop_from(robot, "b")
    assert names(robot, "link") == ["a", "d"]
    assert names(robot, "joint") == ["ad"]


def link_with(inertia, mass=1.0):
    values = " ".join(f'{name}="{value!r}"' for name, value in inertia.items())
    return ElementTree.fromstring(
        f'<robot><link name="a"><inertial><mass value="{mass}"/><inertia {values}/></inertial>'
        "</link></robot>"
    )


KEYS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}


@given(st.lists(moments, min_size=3, max_size=3), st.integers(0, 100))
def test_inertias_of_bodies_stay_and_others_lose_their_products(squares, seed):
    # Of point masses on three axes, turned: always possible.
    x, y, z = squares
    R = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    moment = R @ np.diag([y + z, x + z, x + y]) @ R.T
    inertia = {key: float(moment[place]) for key, place in KEYS.items()}
    assert repair_inertias(link_with(inertia)) == []
    broken = link_with({**inertia, "ixy": inertia["ixx"] + inertia["iyy"]})
    assert repair_inertias(broken) == ["a"]
    assert broken.find("link/inertial/inertia").get("ixy") == "0"
    assert float(broken.find("link/inertial/inertia").get("ixx")) == inertia["ixx"]


def test_links_without_mass_have_no_inertia():
    robot = link_with(dict.fromkeys(KEYS, 0.0), mass=0)
    assert repair_inertias(robot) == []
    assert robot.find("link/inertial") is None


@pytest.mark.parametrize(
    ("text", "line"), [("", "ValueError"), ("\n", "ValueError"), ("\nsecond\nthird", "second")]
)
def test_an_error_without_a_first_line_is_told_in_a_line_too(text, line):
    assert first_line(ValueError(text)) == line


def test_a_file_that_is_no_mesh_is_refused_in_a_line(tmp_path):
    (tmp_path / "no.stl").write_text("solid\nnothing")
    with pytest.raises(InvalidArgumentError, match=r"no.stl cannot be read as a mesh") as error:
        convert_mesh(tmp_path / "no.stl", tmp_path / "part", colors=False)
    assert "\n" not in str(error.value)
