"""Model directives of hands: what they name is checked, and Drake reads copies only."""

import pytest
import trimesh
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from drake_pregrasp.diagrams import directive_files, model_files
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
        ("directives: [add_model: [{name: a, file: /etc/passwd}]]", "add_model: it must be a map"),
        ("directives: [add_weld: world]", "add_weld: it must be a mapping"),
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


def test_a_description_lists_directives_as_a_file_does(folder):
    (file := folder / "hand.yaml").write_text(
        ADD.format("part.urdf").replace("directives", "model") + "fingertips: [{frame: tip}]\n"
    )
    copy = checked_copy(file, [folder])
    assert copy.text == checked_copy(folder / "arm.dmd.yaml", [folder]).text
    file.write_text(ADD.format("../secret.urdf").replace("directives", "model"))
    with pytest.raises(InvalidArgumentError, match=r"hand.yaml: add_model: .*is outside of"):
        checked_copy(file, [folder])
    file.write_text("model: [arm.urdf]")
    with pytest.raises(InvalidArgumentError, match=r"hand.yaml: model: it must be a list of map"):
        checked_copy(file, [folder])


@pytest.mark.parametrize(
    "directives",
    [
        "[add_model: &a {name: arm, file: part.urdf}, add_model: *a]",
        "[&a {add_model: {name: arm, file: part.urdf}}, *a]",
    ],
)
def test_an_alias_names_the_same_file_again(folder, directives):
    (file := folder / "own.dmd.yaml").write_text(f"directives: {directives}")
    copy = checked_copy(file, [folder])
    assert set(copy.files) == {file, folder / "part.urdf"}
    assert copy.text.count(".urdf") == 2


def test_a_package_around_a_file_that_directives_name_allows_nothing(folder):
    (outside := folder.parent / "private").mkdir()
    (outside / "package.xml").write_text("<package><name>private</name></package>")
    (outside / "part.urdf").write_text(URDF)
    (outside / "arm.dmd.yaml").write_text(ADD.format("part.urdf"))
    for text in (ADD.format("../private/part.urdf"), NEST.format("../private/arm.dmd.yaml")):
        (file := folder / "own.dmd.yaml").write_text(text)
        with pytest.raises(InvalidArgumentError, match=r"private.* is outside of"):
            checked_copy(file, [folder])
        with pytest.raises(InvalidArgumentError, match=r"private.* is outside of"):
            checked_copy(outside / "part.urdf", [folder])
        assert checked_copy(file, [folder.parent]).files[-1] == outside / "part.urdf"


def test_parts_of_packages_name_files_of_their_own_package(folder):
    (package := folder / "arm_description").mkdir()
    (package / "package.xml").write_text("<package><name>arm_description</name></package>")
    (package / "arm.dmd.yaml").write_text(ADD.format("package://arm_description/part.urdf"))
    (package / "part.urdf").write_text(URDF)
    (file := folder / "own.dmd.yaml").write_text(NEST.format("arm_description/arm.dmd.yaml"))
    assert package / "part.urdf" in checked_copy(file, [folder]).files


MODEL = "  - add_model: {{name: m{}, file: {}}}\n"
PLATE = '<collision><geometry><mesh filename="{}.stl"/></geometry></collision>'


@pytest.mark.parametrize(
    ("models", "links", "plates", "most", "problem"),
    [
        (21, 1, 1, {}, "more than 20 files"),
        (2, 150, 1, {}, "more than 200 links"),
        (2, 1, 501, {}, "more than 1000 geometries"),
        (2, 1, 1, {"MAX_TRIANGLES": 12}, "more than 12 triangles"),
        (2, 1, 1, {"MAX_PART_BYTES": 1000}, "more than 1000 bytes of meshes"),
        (2, 1, 1, {"MAX_OTHERS": 1}, "more than 1 directives"),
    ],
)
def test_limits_are_for_all_models_together(
    folder, monkeypatch, models, links, plates, most, problem
):
    for name, value in most.items():
        monkeypatch.setattr(directive_files if name == "MAX_OTHERS" else model_files, name, value)
    for mesh in "ab":
        trimesh.creation.box([0.1, 0.1, 0.1]).export(folder / f"{mesh}.stl")  # 684 bytes.
        inside = PLATE.format(mesh) * plates
        parts = "".join(f'<link name="l{i}">{inside}</link>' for i in range(links))
        (folder / f"{mesh}.urdf").write_text(f'<robot name="{mesh}">{parts}</robot>')
    names = "".join(MODEL.format(i, f"{'ab'[i % 2]}.urdf") for i in range(models))
    (file := folder / "own.dmd.yaml").write_text(f"directives:\n{names}")
    with pytest.raises(InvalidArgumentError, match=problem) as error:
        checked_copy(file, [folder])
    assert "own.dmd.yaml" in str(error.value)
