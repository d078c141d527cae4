"""Writes the parallel gripper and its description into this folder.

The files are kept; this script says how they were made. Lengths in metres, angles in radians.
"""

import math

from make_hand import (
    DARK,
    FOLDER,
    PALM_HEAD,
    STEEL,
    TAIL,
    TIP_COLORS,
    VISUAL,
    carrier,
    cylinder,
    frame,
    joint,
    link,
)

NAME = "gripper"
STROKE = 0.055  # Of each jaw.
PAD_RADIUS = 0.010  # Of the round face of a pad, and half of its depth.
FINGER = 0.10  # From the palm down to the middle of the pads.
HOME = 0.046

HEAD = """<?xml version="1.0"?>
<!-- Written by make_gripper.py. A parallel gripper on a carrier of four axes: it slides along x, y
     and z of the world and turns about z. Two jaws slide along x of the palm; each has a finger
     that hangs down and ends in a round, flat pad. With all joints at 0 the palm's frame is the
     world's, and the pads touch. The pads have the colours of the contacts they go to.

     Jaws: like SCHUNK WSG 50-110 (data sheet "WSG 050"): stroke 110 mm, gripping force 80 N, speed
     420 mm/s and acceleration 5 m/s2 of the jaws relative to each other, mass 1.2 kg, size 146 x 50
     x 70 mm. Each jaw has half of stroke, speed, acceleration and force, as the gripping force is
     the sum of both. The data sheet does not state the inertia of motor and spindle: a jaw is
     driven as if they had the mass of 1 kg. Its gain is low, as that of a drive that limits force:
     a jaw that is 1 mm off presses with 1 N.
     Pads: polyurethane with a Young's modulus of 10 MPa.
     Axes: those of five_finger_hand.sdf, whose comment names their sources. -->
<sdf version="1.9" xmlns:drake="http://drake.mit.edu">
  <model name="hand">
"""
DESCRIPTION = f"""\
# The parallel gripper of {NAME}.sdf, on its carrier. The keys are explained in
# drake_pregrasp/config/hand_description.py and docs/own_hand.md.
model: package://drake_pregrasp/{NAME}.sdf
base: !Carrier {{joints: [x, y, z, yaw], palm_height: {FINGER}}}
fingertips:
"""
TIP = """\
  - frame: jaw_{index}_pad
    radius: {radius}
    patch_radius: {radius}
    home: [{home}]
    reach: !BoxReach
      size: [0.06, 0.06, 0.10]
      center: [{x}, 0.0, 0.03]
      direction: [{side}, 0.0, 0.0]
      incidence: 0.4
    closing: {{force: 35.0}}
"""
PART = """      <{kind} name="{name}">
        <pose>{pose}</pose>
        <geometry>{shape}</geometry>
{more}      </{kind}>
"""
MATERIAL = "        <material><diffuse>{color} 1</diffuse></material>\n"
SURFACE = """        <drake:proximity_properties>
{soft}          <drake:mu_dynamic>0.7</drake:mu_dynamic>
        </drake:proximity_properties>
"""
SOFT = """          <drake:compliant_hydroelastic/>
          <drake:hydroelastic_modulus>1e7</drake:hydroelastic_modulus>
          <drake:mesh_resolution_hint>0.006</drake:mesh_resolution_hint>
"""
JAW_DRIVE = {
    "lower": 0,
    "upper": STROKE,
    "effort": 40,
    "speed": 0.21,
    "acceleration": 2.5,
    "rotor": 1.0,
    "gears": 1,
    "p": "1000",
    "d": "70",
}


def box(x: float, y: float, z: float) -> str:
    """Returns a box."""
    return f"<box><size>{x:g} {y:g} {z:g}</size></box>"


def part(name: str, pose: str, shape: str, color: str, soft: str = "") -> str:
    """Returns a part of a link that is seen and touched."""
    place = {"name": name, "pose": pose, "shape": shape}
    return PART.format(kind="visual", more=MATERIAL.format(color=color), **place) + PART.format(
        kind="collision", more=SURFACE.format(soft=soft), **place
    )


def palm() -> str:
    """Returns the parts of the palm: the housing of the jaws, and a flange."""
    housing = part("housing", "0 0 0.04 0 0 0", box(0.146, 0.05, 0.07), DARK)
    return housing + VISUAL.format(
        name="flange", z="0.080", shape=cylinder(0.026, 0.010), color=STEEL
    )


def jaw(index: int) -> str:
    """Returns a jaw with its finger, its pad and the frame in the middle of the pad."""
    base, name, azimuth = f"jaw_{index}_base", f"jaw_{index}", index * math.pi
    pose, middle = f'      <pose relative_to="{base}"/>\n', f"{PAD_RADIUS:g} 0 {-FINGER:g}"
    parts = part("finger", f"0.013 0 {-FINGER / 2:g} 0 0 0", box(0.014, 0.018, FINGER), STEEL)
    disc = cylinder(PAD_RADIUS, 2 * PAD_RADIUS)
    parts += part("pad", f"{middle} 0 {math.pi / 2:.6f} 0", disc, TIP_COLORS[index], SOFT)
    return "".join(
        [
            frame(base, "palm", f"0 0 0 0 0 {azimuth:.6f}"),
            link(name, parts, mass=0.15, length=FINGER, radius=0.01, pose=pose),
            joint(f"{name}_slide", "prismatic", "palm", name, "1 0 0", **JAW_DRIVE),
            frame(f"{name}_pad", name, f"{middle} 0 0 0"),
        ]
    )


def main() -> None:
    """Writes the files."""
    jaws = jaw(0) + jaw(1) + TAIL
    model = HEAD + carrier(palm(), mass=0.9, radius=0.05) + jaws
    (FOLDER / f"{NAME}.sdf").write_text(model, encoding="utf-8")
    alone = link("palm", palm(), mass=0.9, length=0.02, radius=0.05)
    model = PALM_HEAD.format(name=NAME) + alone + jaws
    (FOLDER / f"{NAME}_palm.sdf").write_text(model, encoding="utf-8")
    tips = [
        TIP.format(index=index, radius=PAD_RADIUS, home=HOME, side=side, x=0.03 * side)
        for index, side in enumerate((1.0, -1.0))
    ]
    (FOLDER / f"{NAME}.yaml").write_text(DESCRIPTION + "".join(tips), encoding="utf-8")


if __name__ == "__main__":
    main()
