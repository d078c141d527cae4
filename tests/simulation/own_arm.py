"""A plain arm of six joints as a URDF, and directives that weld a hand on it."""

from pathlib import Path

from pages import DOCS

_LINK = """<link name="{}"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><sphere radius="0.05"/></geometry></collision></link>"""
_JOINT = """<joint name="joint_{}" type="revolute"><parent link="{}"/><child link="{}"/>
<origin xyz="0 0 {}"/><axis xyz="{}"/><limit lower="-3.5" upper="3.5" effort="40" velocity="2"/>
</joint>"""
_LINKS = ("base", "shoulder", "upper_arm", "forearm", "wrist", "palm", "flange")
_LENGTHS = (0.2, 0.15, 0.3, 0.15, 0.15, 0.08)
_AXES = ("0 0 1", "0 1 0", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
_DIRECTIVES = """directives:
- add_model: {{name: arm, file: arm.urdf}}
- add_model: {{name: hand, file: gripper.urdf}}
- add_weld: {{parent: world, child: arm::base, X_PC: {{translation: {}}}}}
- add_weld:
    parent: arm::flange
    child: hand::palm
    X_PC: {{translation: [0.0, 0.0, 0.05], rotation: !Rpy {{deg: [180.0, 0.0, 0.0]}}}}
"""


def write_arm(folder: Path, *, base=(-0.4, 0.0, 0.0), more="") -> Path:
    """Writes an arm with the gripper of the guide, whose palm it calls as a link of its own.

    Args:
        folder: Where the files go.
        base: Position of the base in W, in metres.
        more: What the URDF of the arm has besides.

    Returns:
        The path of the directives.
    """
    parts = [_LINK.format(link) for link in _LINKS]
    ends = zip(_LINKS, _LINKS[1:], _LENGTHS, _AXES, strict=False)
    parts += [_JOINT.format(index, *end) for index, end in enumerate(ends)]
    (folder / "arm.urdf").write_text(f'<robot name="arm">{"".join(parts)}{more}</robot>')
    (folder / "gripper.urdf").write_text((DOCS / "own_hand" / "gripper.urdf").read_text())
    (folder / "robot.dmd.yaml").write_text(_DIRECTIVES.format(list(base)))
    return folder / "robot.dmd.yaml"
