"""The hand's side of the loop: from contact goals to desired joint states."""

from dataclasses import dataclass, field

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import DifferentialInverseKinematicsSystem
from pydrake.multibody.math import SpatialVelocity
from pydrake.planning import DofMask, JointLimits
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.assignment import mean_angle, turned_within
from drake_pregrasp.diagrams.hand_model import HandModel, PalmCarrier
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import Solid
from drake_pregrasp.systems.fingertip_goal_shaper import FingertipGoalShaper
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor
from drake_pregrasp.systems.grasp_sequencer import GraspSequencer
from drake_pregrasp.systems.joint_reference import LARGEST_RATE, JointReference
from drake_pregrasp.systems.palm_posture import ArmPosture, CarrierPosture

POSTURE_GAIN = 5.0
"""How fast the carrier follows its nominal posture, in 1/s."""

_LIMIT_INFLUENCE = 0.05  # Radians or metres from a limit, in which joints slow down.
_TRACKING_WEIGHT = 100.0  # Of fingertips against posture, as Drake's documentation advises.
_POSITION_ONLY = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
_LARGEST_TWIST = SpatialVelocity([5.0] * 3, [1.0] * 3)  # rad/s and m/s, of any fingertip.


def fingertip_kinematics(
    hand: HandModel, more_masks: dict[str, FloatArray], period: float
) -> DifferentialInverseKinematicsSystem:
    """Returns Drake's system for fingertip positions, and for what more there is to follow.

    Its fingertips share out what joints at their limits can't do.

    Args:
        hand: The hand.
        more_masks: Of the frames that it follows beside the fingertips, shape (6,): which of their
            rotations and translations count.
        period: Seconds between control ticks.
    """
    masks = dict.fromkeys(hand.kinematics.tip_frames, _POSITION_ONLY) | more_masks
    tracking = DifferentialInverseKinematicsSystem.LeastSquaresCost.Config()
    tracking.cartesian_qp_weight = _TRACKING_WEIGHT
    tracking.cartesian_axis_masks = masks
    centering = DifferentialInverseKinematicsSystem.JointCenteringCost.Config()
    centering.posture_gain = POSTURE_GAIN
    centering.cartesian_axis_masks = masks
    recipe = DifferentialInverseKinematicsSystem.Recipe()
    recipe.AddIngredient(DifferentialInverseKinematicsSystem.LeastSquaresCost(tracking))
    recipe.AddIngredient(DifferentialInverseKinematicsSystem.JointCenteringCost(centering))
    margins = DifferentialInverseKinematicsSystem.JointVelocityLimitConstraint.Config()
    margins.min_margin, margins.influence_margin = 0.0, _LIMIT_INFLUENCE
    rates = np.full(hand.kinematics.num_positions, LARGEST_RATE)
    endless = np.full(hand.kinematics.num_positions, np.inf)
    limits = JointLimits(
        hand.kinematics.lower, hand.kinematics.upper, -rates, rates, -endless, endless
    )
    recipe.AddIngredient(
        DifferentialInverseKinematicsSystem.JointVelocityLimitConstraint(margins, limits)
    )
    return DifferentialInverseKinematicsSystem(
        recipe=recipe,
        task_frame="world",
        collision_checker=hand.checker,
        active_dof=DofMask([True] * hand.kinematics.num_positions),
        time_step=period,
        K_VX=1.0,
        Vd_TG_limit=_LARGEST_TWIST,
    )


@dataclass(frozen=True)
class AddedPosture:
    """A posture in a diagram that is being built.

    Attributes:
        system: It has the ports `tip_goals`, `X_WG`, `V_WG`, `X_WO_estimated`, `nominal_posture`
            and `X_WH`.
        goals: All that differential inverse kinematics follows.
        masks: Of frames that it follows beside the fingertips.
    """

    system: CarrierPosture | ArmPosture
    goals: OutputPort
    masks: dict[str, FloatArray] = field(default_factory=dict)


def add_posture(
    builder: DiagramBuilder,
    hand: HandModel,
    tip_goals: OutputPort,
    *,
    p_WG: FloatArray,
    yaw: float,
    yaw_range: tuple[float, float],
    lead: float,
    gain: float,
    period: float,
) -> AddedPosture:
    """Adds the posture system for what carries a hand.

    Args:
        builder: Where to add it.
        hand: The hand.
        tip_goals: Of `FingertipGoalShaper`.
        p_WG: Where the goals' frame G is at the start, shape (3,), in metres.
        yaw: Of the palm at the start, in radians.
        yaw_range: Least and largest angle of the palm, in radians.
        lead: For when the goals are, in seconds after the Context's time.
        gain: With which joints follow a posture, in 1/s.
        period: Seconds between control ticks.
    """
    base = hand.base
    if isinstance(base, PalmCarrier):
        carried = builder.AddNamedSystem(
            "carrier_posture",
            CarrierPosture(
                tip_frames=hand.kinematics.tip_frames,
                finger_azimuths=hand.azimuths,
                home=hand.home(np.zeros(3), yaw),
                carrier=base.joints,
                gain=gain,
                period=period,
                yaw_range=yaw_range,
            ),
        )
        builder.Connect(tip_goals, carried.GetInputPort("tip_goals"))
        return AddedPosture(carried, tip_goals)
    held = builder.AddNamedSystem(
        "arm_posture",
        ArmPosture(
            tip_frames=hand.kinematics.tip_frames,
            palm_frame=base.palm_frame,
            finger_azimuths=hand.azimuths,
            X_GP=base.X_GP,
            home=hand.relaxed,
            p_WG=p_WG,
            yaw=yaw,
            lead=lead,
            period=period,
            yaw_range=yaw_range,
        ),
    )
    builder.Connect(tip_goals, held.GetInputPort("tip_goals"))
    masks = {base.palm_frame: np.ones(6)}
    return AddedPosture(held, held.GetOutputPort("goals"), masks)


class HandController(Diagram):
    """Follows contact goals with fingertips, and on command grasps and lifts.

    .. pydrake_system::

        name: HandController
        input_ports:
        - fingertip_targets
        - contact_status
        - X_WO_estimated
        - V_WO_estimated
        - close
        - hand_state
        - net_actuation
        - obstacles
        - tracking_status
        output_ports:
        - desired_state
        - p_GT
        - p_WT
        - f_T_W
        - X_WG
        - X_WH
        - hold_contacts
        - grasp_report

    The ports are those of the systems inside, which document them. From the planner come
    `fingertip_targets`, `contact_status`, `X_WO_estimated`, `V_WO_estimated` and, optional,
    `tracking_status`; `obstacles` is optional, too; `close` is the command. From the hand's plant
    come `hand_state` and `net_actuation`, and back goes `desired_state` (`JointReference`). For
    those who watch there are `p_GT` (`FingertipGoalShaper`), `p_WT` and `f_T_W`
    (`FingertipSensor`), `X_WG` and `grasp_report` (`GraspSequencer`). For the planner there are
    `X_WH` (`CarrierPosture` or `ArmPosture`), with which it knows what fingers reach, and
    `hold_contacts` (`GraspSequencer`), with which it rests while the hand grasps.

    Goals are carried ahead by the control period, in which the reference gets there, and by the
    plant's time step, at whose start it samples desired states.

    The attribute `initial` holds the hand's positions at the start, shape (nq,): over the object,
    raised, and turned to its contacts.

    Args:
        config: How it grasps.
        hand: The hand.
        object_solid: The object in O, convex.
        object_top: How high it reaches over O, in metres.
        mass: Of the object, in kg.
        p_OCoM: Its centre of mass in O, shape (3,), in metres.
        fixed: Solids in W to keep fingertips out of, as the table.
        X_WO: Where the object is at the start.
        p_OC: Its initial contacts in O, in the order of the fingers, shape (n, 3), in metres.
        target_period: Seconds between ticks of the planner.
        plant_time_step: Of the hand's plant, in seconds.

    Raises:
        InvalidArgumentError: If an argument is out of its range, or an arm can't bring the palm
            over the object.
    """

    initial: FloatArray

    def __init__(
        self,
        config: GraspConfig,
        hand: HandModel,
        *,
        object_solid: Solid,
        object_top: float,
        mass: float,
        p_OCoM: FloatArray,
        fixed: list[Solid],
        X_WO: RigidTransform,
        p_OC: FloatArray,
        target_period: float,
        plant_time_step: float,
    ) -> None:
        super().__init__()
        n = len(hand.kinematics.tip_frames)
        for name, value, shape in (("p_OC", p_OC, (n, 3)), ("p_OCoM", p_OCoM, (3,))):
            if np.shape(value) != shape:
                raise InvalidArgumentError(f"{name} must have shape {shape}, not {np.shape(value)}")
        for name, amount in (("mass", mass), ("plant_time_step", plant_time_step)):
            if not amount > 0:
                raise InvalidArgumentError(f"{name} must be greater than 0, not {amount}")
        if not config.touch_force < config.least_force:
            raise InvalidArgumentError(
                f"touch_force must be less than least_force, {config.least_force}, not"
                f" {config.touch_force}"
            )
        builder = DiagramBuilder()
        tip_frames = hand.kinematics.tip_frames
        settings = config.make_settings(hand.description.fingertips)
        raised = np.array([0.0, 0.0, settings.approach_height])
        X_WG = RigidTransform(X_WO.rotation(), X_WO.translation() + raised)
        p_CoMC_W = (X_WO.rotation() @ (p_OC - p_OCoM).T).T
        turn = mean_angle(np.arctan2(p_CoMC_W[:, 1], p_CoMC_W[:, 0]) - hand.azimuths)
        yaw_range = hand.yaw_range(config.yaw_range)
        yaw = turned_within(turn, yaw_range)
        self.initial = hand.home(X_WG.translation(), yaw)
        shaper = builder.AddNamedSystem(
            "fingertip_goal_shaper",
            FingertipGoalShaper(
                config,
                tip_frames=tip_frames,
                tip_radius=hand.tip_radii,
                object_solid=object_solid,
                object_top=object_top,
                fixed=fixed,
                p_GT=(X_WG.inverse() @ hand.tips_at(self.initial).T).T,
                finger_azimuths=hand.azimuths,
                target_period=target_period,
                lead=config.period + plant_time_step,
                withdrawn_radii=hand.withdrawn_radii,
            ),
        )
        added = add_posture(
            builder,
            hand,
            shaper.GetOutputPort("tip_goals"),
            p_WG=X_WG.translation(),
            yaw=yaw,
            yaw_range=yaw_range,
            lead=config.period + plant_time_step,
            gain=POSTURE_GAIN,
            period=config.period,
        )
        posture = added.system
        kinematics = builder.AddNamedSystem(
            "differential_ik", fingertip_kinematics(hand, added.masks, config.period)
        )
        builder.Connect(added.goals, kinematics.GetInputPort("desired_cartesian_poses"))
        reference = builder.AddNamedSystem(
            "joint_reference",
            JointReference(hand.kinematics, period=config.period, initial=self.initial),
        )
        sensor = builder.AddNamedSystem("fingertip_sensor", FingertipSensor(hand.kinematics))
        sequencer = builder.AddNamedSystem(
            "grasp_sequencer",
            GraspSequencer(
                config, fingertips=hand.description.fingertips, mass=mass, p_OCoM=p_OCoM
            ),
        )
        for source, output, target, target_input in (
            (sequencer, "X_WG", shaper, "X_WG"),
            (sequencer, "V_WG", shaper, "V_WG"),
            (sequencer, "standoffs", shaper, "standoffs"),
            (sequencer, "hold_contacts", shaper, "hold_contacts"),
            (sequencer, "X_WG", posture, "X_WG"),
            (sequencer, "V_WG", posture, "V_WG"),
            (sequencer, "fingers_hold", shaper, "fingers_hold"),
            (posture, "X_WU", shaper, "X_WU"),
            (posture, "nominal_posture", kinematics, "nominal_posture"),
            (reference, "position", kinematics, "position"),
            (kinematics, "commanded_velocity", reference, "commanded_velocity"),
            (sequencer, "squeeze_forces", reference, "f_T_W"),
            (shaper, "contact_frames", sequencer, "contact_frames"),
            (sensor, "p_WT", sequencer, "p_WT"),
            (sensor, "f_T_W", sequencer, "f_T_W"),
        ):
            builder.Connect(source.GetOutputPort(output), target.GetInputPort(target_input))

        builder.ExportInput(shaper.GetInputPort("fingertip_targets"), "fingertip_targets")
        for name, (first, *others) in (
            ("contact_status", (shaper, sequencer)),
            ("X_WO_estimated", (shaper, sequencer, posture)),
            ("V_WO_estimated", (sequencer,)),
            ("close", (sequencer,)),
            ("hand_state", (sensor,)),
            ("net_actuation", (sensor,)),
            ("obstacles", (shaper,)),
            ("tracking_status", (shaper, sequencer)),
        ):
            builder.ExportInput(first.GetInputPort(name), name)
            for system in others:
                builder.ConnectInput(name, system.GetInputPort(name))
        for system, name in (
            (reference, "desired_state"),
            (shaper, "p_GT"),
            (sensor, "p_WT"),
            (sensor, "f_T_W"),
            (sequencer, "X_WG"),
            (posture, "X_WH"),
            (sequencer, "hold_contacts"),
            (sequencer, "grasp_report"),
        ):
            builder.ExportOutput(system.GetOutputPort(name), name)
        builder.BuildInto(self)
