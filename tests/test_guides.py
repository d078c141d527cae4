import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform

from drake_pregrasp import load_scenario, run

DOCS = Path(__file__).parent.parent / "docs"


def block(page, language):
    text = (DOCS / page).read_text(encoding="utf-8")
    return "".join(re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL))


@pytest.fixture
def thing(tmp_path, monkeypatch):
    """A mesh file in millimetres, in the working directory."""
    monkeypatch.chdir(tmp_path)
    trimesh.creation.cone(radius=40, height=110).export("thing.stl")


@pytest.mark.usefixtures("thing")
def test_the_guide_to_meshes_is_followed_as_it_stands():
    Path("mine.yaml").write_text(block("own_mesh.md", "yaml"))
    result = run(load_scenario(file="mine.yaml"), name="mine", out="runs", recording=False)
    assert result.summary["final"]["q_msv"] > 2
    assert result.summary["inactive_contacts"] == {}
    names: dict[str, object] = {}
    exec(compile(block("own_mesh.md", "python"), "own_mesh.md", "exec"), names)
    surface = names["surface"]
    assert surface.patches[:, :, 2].min() >= 0.03
    context = names["diagram"].CreateDefaultContext()
    names["diagram"].GetInputPort("X_WO_measured").FixValue(context, RigidTransform())
    p_WC = names["diagram"].GetOutputPort("p_WC").Eval(context).reshape(-1, 3)
    assert np.all(np.linalg.norm(p_WC - [0.1, 0.0, 0.05], axis=1) > 0.03)


def test_the_strong_finger_owns_what_asks_for_much():
    names: dict[str, object] = {}
    exec(compile(block("more_coordinates.md", "python"), "more_coordinates.md", "exec"), names)
    weak, strong = names["heights"]
    assert strong > weak + 0.02


def test_the_guide_to_composing_lifts_the_cube(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(block("compose.md", "python"), "compose.md", "exec"), names)
    assert names["X_WO"].translation()[2] == pytest.approx(0.15, abs=2e-3)


def test_the_guide_to_a_hand_of_your_own_grasps_with_it(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_hand.yaml").write_text(block("own_hand.md", "yaml"))
    (options,) = re.findall(r"--scenario_text '(.*)'", (DOCS / "own_hand.md").read_text())
    scenario = load_scenario("grasp_five_finger", text=options)
    grasp = run(scenario, name="mine", out=tmp_path, recording=False).summary["grasp"]
    assert (grasp["phase"], grasp["gave_up"]) == ("hold", None)
    assert grasp["lift_height_mm"] > 98


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https)([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert (DOCS / target).exists(), target
