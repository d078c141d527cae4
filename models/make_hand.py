"""Writes five_finger_hand.sdf into this folder.

The file is kept; this script says how it was made. Lengths in metres, angles in radians.
"""

import math
from pathlib import Path

FOLDER = Path(__file__).parent

NUM_FINGERS = 5
KNUCKLE_CIRCLE = 0.050
PROXIMAL, DISTAL = 0.090, 0.110
LINK_RADIUS, TIP_RADIUS = 0.006, 0.009
TIP_COLORS = (
    "0 0.447 0.698",
    "0.902 0.624 0",
    "0 0.62 0.451",
    "0.8 0.475 0.655",
    "0.337 0.706 0.914",
)

HEAD = """<?xml version="1.0"?>
<!-- Written by make_hand.py. A radial hand of five fingers on a carrier of four axes: it slides
     along x, y and z of the world and turns about z. Each finger hangs from a knuckle at the palm's
     rim, swings sideways about the radial axis, pitches outward and curls inward. With all joints
     at 0 the palm's frame is the world's, and the fingers hang straight down. The tips have the
     colours of the contacts they go to. -->
<sdf version="1.9" xmlns:drake="http://drake.mit.edu">
  <model name="hand">
"""
TAIL = """  </model>
</sdf>
"""
AXIS = """    <joint name="{name}" type="{kind}">
      <parent>{parent}</parent>
      <child>{child}</child>
      <axis>
        <xyz>{xyz}</xyz>
        <limit><lower>{lower}</lower><upper>{upper}</upper><effort>{effort}</effort></limit>
      </axis>
      <drake:rotor_inertia>{rotor}</drake:rotor_inertia>
      <drake:gear_ratio>1</drake:gear_ratio>
      <drake:controller_gains p="{p}" d="{d}"/>
    </joint>
"""
INERTIAL = """      <inertial>
        <pose>0 0 {z} 0 0 0</pose>
        <mass>{mass}</mass>
        <inertia>
          <ixx>{ixx}</ixx><iyy>{iyy}</iyy><izz>{izz}</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz>
        </inertia>
      </inertial>
"""
VISUAL = """      <visual name="{name}">
        <pose>0 0 {z} 0 0 0</pose>
        <geometry>{shape}</geometry>
        <material><diffuse>{color} 1</diffuse></material>
      </visual>
"""
COLLISION = """      <collision name="{name}">
        <pose>0 0 {z} 0 0 0</pose>
        <geometry>{shape}</geometry>
        <drake:proximity_properties>
          <drake:mu_dynamic>0.7</drake:mu_dynamic>
        </drake:proximity_properties>
      </collision>
"""
STEEL, DARK = "0.42 0.44 0.48", "0.25 0.27 0.30"


def cylinder(radius: float, length: float) -> str:
    """Returns a cylinder along z."""
    return f"<cylinder><radius>{radius:g}</radius><length>{length:g}</length></cylinder>"


def capsule(radius: float, length: float) -> str:
    """Returns a capsule along z."""
    return f"<capsule><radius>{radius:g}</radius><length>{length:g}</length></capsule>"


def ball(radius: float) -> str:
    """Returns a ball."""
    return f"<sphere><radius>{radius:g}</radius></sphere>"


def link(
    name: str, parts: str, *, mass: float, length: float, radius: float, pose: str = ""
) -> str:
    """Returns a link with the inertia of a rod that hangs down from its frame."""
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    inertial = INERTIAL.format(
        z=f"{-length / 2:g}",
        mass=mass,
        ixx=f"{across:.4g}",
        iyy=f"{across:.4g}",
        izz=f"{along:.4g}",
    )
    return f'    <link name="{name}">\n{pose}{inertial}{parts}    </link>\n'


def joint(name: str, kind: str, parent: str, child: str, xyz: str, **numbers: object) -> str:
    """Returns a driven joint."""
    return AXIS.format(name=name, kind=kind, parent=parent, child=child, xyz=xyz, **numbers)


def frame(name: str, body: str, pose: str) -> str:
    """Returns a frame of a body."""
    return f'    <frame name="{name}" attached_to="{body}"><pose>{pose}</pose></frame>\n'


def carrier() -> str:
    """Returns the axes x, y, z and yaw, and the palm."""
    slide = {"lower": -1.5, "upper": 1.5, "effort": 1000, "rotor": 0, "p": "2e4", "d": "800"}
    turn = {"lower": -31.4, "upper": 31.4, "effort": 100, "rotor": 0, "p": "400", "d": "20"}
    mast = VISUAL.format(name="mast", z="0.17", shape=cylinder(0.014, 0.30), color=STEEL)
    disc = VISUAL.format(name="disc", z="0.014", shape=cylinder(0.056, 0.016), color=DARK)
    flange = VISUAL.format(name="flange", z="0.030", shape=cylinder(0.026, 0.020), color=STEEL)
    return "".join(
        [
            link("carriage", "", mass=0.5, length=0.1, radius=0.05),
            joint("x", "prismatic", "world", "carriage", "1 0 0", **slide),
            link("bridge", "", mass=0.5, length=0.1, radius=0.05),
            joint("y", "prismatic", "carriage", "bridge", "0 1 0", **slide),
            link("column", mast, mass=0.5, length=0.1, radius=0.05),
            joint("z", "prismatic", "bridge", "column", "0 0 1", **slide),
            link("palm", disc + flange, mass=0.6, length=0.02, radius=0.056),
            joint("yaw", "revolute", "column", "palm", "0 0 1", **turn),
        ]
    )


def finger(index: int) -> str:
    """Returns a finger of three joints and its tip's frame."""
    azimuth = 2 * math.pi * index / NUM_FINGERS
    base, name = f"finger_{index}_base", f"finger_{index}"
    x, y = KNUCKLE_CIRCLE * math.cos(azimuth), KNUCKLE_CIRCLE * math.sin(azimuth)
    here = f'      <pose relative_to="{base}"/>\n'
    below = f'      <pose relative_to="{base}">0 0 {-PROXIMAL:g} 0 0 0</pose>\n'
    drive = {"effort": 8, "rotor": 1e-3, "p": "12", "d": "0.5"}
    knuckle = VISUAL.format(name="knuckle", z="0", shape=ball(0.010), color=DARK)
    upper = VISUAL.format(
        name="link", z=f"{-PROXIMAL / 2:g}", shape=capsule(LINK_RADIUS, PROXIMAL), color=STEEL
    )
    upper += COLLISION.format(
        name="link", z=f"{-PROXIMAL / 2:g}", shape=capsule(LINK_RADIUS, PROXIMAL)
    )
    lower = VISUAL.format(name="joint", z="0", shape=ball(0.008), color=DARK)
    lower += VISUAL.format(
        name="link", z=f"{-DISTAL / 2:g}", shape=cylinder(LINK_RADIUS, DISTAL), color=STEEL
    )
    lower += VISUAL.format(
        name="tip", z=f"{-DISTAL:g}", shape=ball(TIP_RADIUS), color=TIP_COLORS[index]
    )
    lower += COLLISION.format(
        name="link",
        z=f"{-(DISTAL - TIP_RADIUS) / 2:g}",
        shape=capsule(LINK_RADIUS, DISTAL - TIP_RADIUS),
    )
    lower += COLLISION.format(name="tip", z=f"{-DISTAL:g}", shape=ball(TIP_RADIUS))
    return "".join(
        [
            frame(base, "palm", f"{x:.6f} {y:.6f} 0 0 0 {azimuth:.6f}"),
            link(f"{name}_knuckle", knuckle, mass=0.02, length=0.02, radius=0.01, pose=here),
            joint(
                f"{name}_swing",
                "revolute",
                "palm",
                f"{name}_knuckle",
                "1 0 0",
                lower=-0.9,
                upper=0.9,
                **drive,
            ),
            link(
                f"{name}_proximal", upper, mass=0.05, length=PROXIMAL, radius=LINK_RADIUS, pose=here
            ),
            joint(
                f"{name}_pitch",
                "revolute",
                f"{name}_knuckle",
                f"{name}_proximal",
                "0 -1 0",
                lower=-0.3,
                upper=1.5,
                **drive,
            ),
            link(f"{name}_distal", lower, mass=0.05, length=DISTAL, radius=LINK_RADIUS, pose=below),
            joint(
                f"{name}_curl",
                "revolute",
                f"{name}_proximal",
                f"{name}_distal",
                "0 1 0",
                lower=0,
                upper=2.4,
                **drive,
            ),
            frame(f"{name}_tip", f"{name}_distal", f"0 0 {-DISTAL:g} 0 0 0"),
        ]
    )


def main() -> None:
    """Writes the file."""
    fingers = "".join(finger(index) for index in range(NUM_FINGERS))
    (FOLDER / "five_finger_hand.sdf").write_text(
        HEAD + carrier() + fingers + TAIL, encoding="utf-8"
    )


if __name__ == "__main__":
    main()
