"""Model directives of hands: what they name is checked, and Drake reads copies only."""

import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from drake_pregrasp.diagrams.directive_files import checked_copy
from drake_pregrasp.errors import InvalidArgumentError

URDF = '<robot name="part"><link name="base"/></robot>'
ADD = "directives:\n  - add_model: {{name: arm, file: {}}}\n"
NEST = "directives:\n  - add_directives: {{file: {}}}\n"


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "part.urdf").write_text(URDF)
    (folder / "arm.dmd.yaml").write_text(ADD.format("part.urdf"))
    (folder / "loop.dmd.yaml").write_text(NEST.format("loop.dmd.yaml"))
    (tmp_path / "secret.urdf").write_text(URDF)
    (tmp_path / "secret.dmd.yaml").write_text(ADD.format("own/part.urdf"))
    return folder


def test_nested_directives_are_parsed_by_drake_from_copies(folder):
    (file := folder / "both.dmd.yaml").write_text(
        NEST.format("arm.dmd.yaml")
        + "  - add_weld: {parent: world, child: arm::base, X_PC: {translation: [1, 2, 3],"
        " rotation: !Rpy {deg: [0, 0, 90]}}}\n"
    )
    copy = checked_copy(file, [folder])
    assert set(copy.files) == {file, folder / "arm.dmd.yaml", folder / "part.urdf"}
    assert str(folder) not in copy.text
    plant = MultibodyPlant(0.0)
    (arm,) = Parser(plant).AddModelsFromString(copy.text, copy.kind)
    plant.Finalize()
    X_WB = plant.GetFrameByName("base", arm).CalcPoseInWorld(plant.CreateDefaultContext())
    assert X_WB.translation().tolist() == [1.0, 2.0, 3.0]
    assert X_WB.rotation().matrix()[1, 0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (ADD.format("../secret.urdf"), "add_model: .*secret.urdf is outside of"),
        (ADD.format("/etc/passwd"), "add_model: /etc/passwd is outside of"),
        (ADD.format("https://a.b/c.urdf"), "only files and packages are read"),
        (ADD.format("package://no_such_package/c.urdf"), "no such package is here"),
        (ADD.format("robots://shadow.urdf"), "there is no robot robots://shadow.urdf"),
        (NEST.format("../secret.dmd.yaml"), "add_directives: .*secret.dmd.yaml is outside of"),
        (NEST.format("loop.dmd.yaml"), "loop.dmd.yaml is named twice"),
        ("directives: 3", "directives: it must be a list of mappings"),
        ("directives: [", "is not valid YAML"),
        ("a: &a [*a]", "an alias contains itself"),
    ],
)
def test_files_elsewhere_and_broken_directives_are_refused_in_one_line(folder, text, problem):
    (file := folder / "own.dmd.yaml").write_text(text)
    with pytest.raises(InvalidArgumentError, match=problem) as error:
        checked_copy(file, [folder])
    assert "\n" not in str(error.value)
    assert "own.dmd.yaml" in str(error.value)
