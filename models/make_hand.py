"""Writes the radial hands of three, four and five fingers and their descriptions into this folder.

The files are kept; this script says how they were made. Lengths in metres, angles in radians.
"""

import math
from collections.abc import Callable
from pathlib import Path

FOLDER = Path(__file__).parent

NUMBERS = {3: "three", 4: "four", 5: "five"}
KNUCKLE_CIRCLE = 0.050
PROXIMAL, DISTAL = 0.090, 0.110
LINK_RADIUS, TIP_RADIUS = 0.006, 0.009
SERVO_RADIUS = 0.013  # Radius of the ball around the cross-section of a finger's servo.
TIP_COLORS = (
    "0 0.447 0.698",
    "0.902 0.624 0",
    "0 0.62 0.451",
    "0.8 0.475 0.655",
    "0.337 0.706 0.914",
)

PALM_HEAD = """<?xml version="1.0"?>
<!-- The hand of {name}.sdf, which explains it, without carrier; written by the same script. -->
<sdf version="1.9" xmlns:drake="http://drake.mit.edu">
  <model name="hand">
"""
HEAD = """<?xml version="1.0"?>
<!-- Written by make_hand.py. A radial hand of {number} fingers on a carrier of four axes: it slides
     along x, y and z of the world and turns about z. Each finger hangs from a knuckle at the palm's
     rim, swings sideways about the radial axis, pitches outward and curls inward. With all joints
     at 0 the palm's frame is the world's, and the fingers hang straight down. The tips have the
     colours of the contacts they go to.

     Drives, with the values of their data sheets:
     Fingers: ROBOTIS DYNAMIXEL XC330-T288-T at 12 V, emanual.robotis.com/docs/en/dxl/x/xc330-t288:
     stall torque 1.00 N m, no-load speed 71 rev/min, gear ratio 288.35, mass 23 g, size 20 x 34
     x 26 mm. Two of them in a finger's knuckle and elbow, one in the palm.
     Wrist: DYNAMIXEL XH540-W270 at 12 V: 9.9 N m, 39 rev/min, gear ratio 272.5, mass 165 g.
     x, y, z: a toothed-belt axis like Festo ELGA-TB-KF-70, with a feed force of 350 N. It allows
     5 m/s and 50 m/s2; 1.5 m/s and 10 m/s2 are used, as for heavier loads.

     ROBOTIS does not state the inertia of rotors. The mechanical time constant of motors without
     iron cores is 7 to 8 ms (Faulhaber 1331 SR and 1524 SR), and that constant times stall torque
     over speed is the reflected inertia: 1e-3 kg m2 for a finger, 1.8e-2 kg m2 for the wrist. The
     rotor's own inertia is this over the square of the gear ratio. The rotor inertia of a linear
     axis is the equivalent mass of its motor, in kg.

     Accelerations: a fifth of a servo's stall torque, ROBOTIS' bound for smooth motion, accelerates
     a stretched finger with its rotor, 2e-3 kg m2, by 100 rad/s2, and the hand about the wrist,
     2.5e-2 kg m2, by 80 rad/s2. -->
<sdf version="1.9" xmlns:drake="http://drake.mit.edu">
  <model name="hand">
"""
DESCRIPTION = """\
# The radial hand of {name}.sdf, on its carrier. The keys are explained in
# drake_pregrasp/config/hand_description.py and docs/own_hand.md.
model: package://drake_pregrasp/{name}.sdf
base: !Carrier {{joints: [x, y, z, yaw], palm_height: 0.155}}
fingertips:
"""
FAST = """\
# The radial hand of five_finger_hand.sdf on faster axes, to catch objects in the air: 3 m/s and
# 25 m/s2. The same toothed-belt axis, ELGA-TB-KF-70 of Festo, allows 5 m/s and 50 m/s2 with a feed
# force of 350 N; 25 m/s2 of the slowest axis of the model, 11 kg with its motor, take 280 N. It is
# idealised: the beams of a real gantry with 3 m of travel are heavier, and they bend.
# An object that comes along the palm's axis passes between the fingertips: they touch within 20 mm
# of the plane across this axis (boxes), on sides that are at most 29 degrees from parallel to it
# (elevation).
model: package://drake_pregrasp/five_finger_hand.sdf
base: !Carrier {joints: [x, y, z, yaw], palm_height: 0.155}
drives:
"""
DRIVE = (
    "  - {{joints: [{joints}], stiffness: {p}, damping: {d}, rotor_inertia: {inertia:.3g},"
    " effort: {effort}, speed: {speed}, acceleration: {acceleration}}}\n"
)
TAIL = """  </model>
</sdf>
"""
AXIS = """    <joint name="{name}" type="{kind}">
      <parent>{parent}</parent>
      <child>{child}</child>
      <axis>
        <xyz>{xyz}</xyz>
        <limit>
          <lower>{lower}</lower><upper>{upper}</upper><effort>{effort}</effort>
          <velocity>{speed}</velocity><drake:acceleration>{acceleration}</drake:acceleration>
        </limit>
      </axis>
      <drake:rotor_inertia>{rotor}</drake:rotor_inertia>
      <drake:gear_ratio>{gears}</drake:gear_ratio>
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
AXIS_DRIVE = {
    "effort": 350,
    "speed": 1.5,
    "acceleration": 10,
    "rotor": 2.0,
    "gears": 1,
    "p": "1e5",
    "d": "2000",
}
WRIST_DRIVE = {
    "effort": 9.9,
    "speed": 4.08,
    "acceleration": 80,
    "rotor": 2.4e-7,
    "gears": 272.5,
    "p": "400",
    "d": "20",
}
FINGER_DRIVE = {
    "effort": 1.0,
    "speed": 7.44,
    "acceleration": 100,
    "rotor": 1.2e-8,
    "gears": 288.35,
    "p": "12",
    "d": "0.5",
}
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


def carrier(palm: str, mass: float, radius: float) -> str:
    """Returns the axes x, y, z and yaw, and a palm of the given parts, mass and radius."""
    slide = {"lower": -1.5, "upper": 1.5, **AXIS_DRIVE}
    turn = {"lower": -31.4, "upper": 31.4, **WRIST_DRIVE}
    mast = VISUAL.format(name="mast", z="0.17", shape=cylinder(0.014, 0.30), color=STEEL)
    return "".join(
        [
            link("carriage", "", mass=3.0, length=0.1, radius=0.05),
            joint("x", "prismatic", "world", "carriage", "1 0 0", **slide),
            link("bridge", "", mass=3.0, length=0.1, radius=0.05),
            joint("y", "prismatic", "carriage", "bridge", "0 1 0", **slide),
            link("column", mast, mass=2.0, length=0.1, radius=0.05),
            joint("z", "prismatic", "bridge", "column", "0 0 1", **slide),
            link("palm", palm, mass=mass, length=0.02, radius=radius),
            joint("yaw", "revolute", "column", "palm", "0 0 1", **turn),
        ]
    )


def radial_palm() -> str:
    """Returns the parts of the palm of a radial hand."""
    disc = VISUAL.format(name="disc", z="0.014", shape=cylinder(0.056, 0.016), color=DARK)
    disc += COLLISION.format(name="disc", z="0.014", shape=cylinder(0.056, 0.016))
    return disc + VISUAL.format(name="flange", z="0.030", shape=cylinder(0.026, 0.020), color=STEEL)


def finger(index: int, azimuth: float) -> str:
    """Returns a finger of three joints and its tip's frame."""
    base, name = f"finger_{index}_base", f"finger_{index}"
    x, y = KNUCKLE_CIRCLE * math.cos(azimuth), KNUCKLE_CIRCLE * math.sin(azimuth)
    here = f'      <pose relative_to="{base}"/>\n'
    below = f'      <pose relative_to="{base}">0 0 {-PROXIMAL:g} 0 0 0</pose>\n'
    knuckle = VISUAL.format(name="knuckle", z="0", shape=ball(SERVO_RADIUS), color=DARK)
    knuckle += COLLISION.format(name="knuckle", z="0", shape=ball(SERVO_RADIUS))
    upper = VISUAL.format(
        name="link", z=f"{-PROXIMAL / 2:g}", shape=capsule(LINK_RADIUS, PROXIMAL), color=STEEL
    )
    upper += COLLISION.format(
        name="link", z=f"{-PROXIMAL / 2:g}", shape=capsule(LINK_RADIUS, PROXIMAL)
    )
    upper += VISUAL.format(name="elbow", z=f"{-PROXIMAL:g}", shape=ball(SERVO_RADIUS), color=DARK)
    upper += COLLISION.format(name="elbow", z=f"{-PROXIMAL:g}", shape=ball(SERVO_RADIUS))
    lower = VISUAL.format(
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
            link(f"{name}_knuckle", knuckle, mass=0.04, length=0.02, radius=0.01, pose=here),
            joint(
                f"{name}_swing",
                "revolute",
                "palm",
                f"{name}_knuckle",
                "1 0 0",
                lower=-0.9,
                upper=0.9,
                **FINGER_DRIVE,
            ),
            link(
                f"{name}_proximal",
                upper,
                mass=0.045,
                length=PROXIMAL,
                radius=LINK_RADIUS,
                pose=here,
            ),
            joint(
                f"{name}_pitch",
                "revolute",
                f"{name}_knuckle",
                f"{name}_proximal",
                "0 -1 0",
                lower=-0.3,
                upper=1.5,
                **FINGER_DRIVE,
            ),
            link(f"{name}_distal", lower, mass=0.02, length=DISTAL, radius=LINK_RADIUS, pose=below),
            joint(
                f"{name}_curl",
                "revolute",
                f"{name}_proximal",
                f"{name}_distal",
                "0 1 0",
                lower=0,
                upper=2.4,
                **FINGER_DRIVE,
            ),
            frame(f"{name}_tip", f"{name}_distal", f"0 0 {-DISTAL:g} 0 0 0"),
        ]
    )


def fingertips(azimuths: list[float], reach: Callable[[float], str], closing: str = "") -> str:
    """Returns the fingertips of a description, with the reach at an azimuth and further keys."""
    tips = [
        f"  - {{frame: finger_{index}_tip, radius: {TIP_RADIUS}, home: [0.0, 0.9, 1.35],{closing}"
        f" reach: {reach(azimuth)}}}\n"
        for index, azimuth in enumerate(azimuths)
    ]
    return "".join(tips)


def sector(azimuth: float) -> str:
    """Returns the reach of a finger on its side of the palm's axis, at any height."""
    return f"!SectorReach {{azimuth: {round(azimuth, 4)}, half_angle: 1.13}}"


def slab(azimuth: float) -> str:
    """Returns the reach of a finger on its side of the palm's axis, near the plane across it."""
    x, y = math.cos(azimuth), math.sin(azimuth)
    return (
        f"!BoxReach {{center: [{0.06 * x:.4f}, {0.06 * y:.4f}, 0], size: [0.12, 0.18, 0.04],"
        f" rpy: [0, 0, {azimuth:.4f}], direction: [{x:.4f}, {y:.4f}, 0], incidence: 1.22,"
        " elevation: 0.5}"
    )


def drive(joints: str, numbers: dict[str, float]) -> str:
    """Returns a drive of a description."""
    inertia = numbers["rotor"] * numbers["gears"] ** 2
    return DRIVE.format(joints=joints, inertia=inertia, **numbers)


def main() -> None:
    """Writes the files."""
    for count, number in NUMBERS.items():
        name, azimuths = f"{number}_finger_hand", [2 * math.pi * k / count for k in range(count)]
        fingers = "".join(finger(index, azimuth) for index, azimuth in enumerate(azimuths))
        palm = carrier(radial_palm(), mass=0.6, radius=0.056)
        model = HEAD.format(number=number) + palm + fingers + TAIL
        (FOLDER / f"{name}.sdf").write_text(model, encoding="utf-8")
        text = DESCRIPTION.format(name=name) + fingertips(azimuths, sector)
        (FOLDER / f"{name}.yaml").write_text(text, encoding="utf-8")
    palm = link("palm", radial_palm(), mass=0.6, length=0.02, radius=0.056)
    model = PALM_HEAD.format(name=name) + palm + fingers + TAIL
    (FOLDER / "five_finger_palm.sdf").write_text(model, encoding="utf-8")
    fast = {**AXIS_DRIVE, "p": "1.0e+5", "speed": 3.0, "acceleration": 25}
    drives = [drive("x, y, z", fast), drive("yaw", WRIST_DRIVE), drive("", FINGER_DRIVE)]
    tips = fingertips(azimuths, slab, " closing: {speed: 0.5},")
    text = "".join([FAST, *drives, "fingertips:\n", tips])
    (FOLDER / "five_finger_fast.yaml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
