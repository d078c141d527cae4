"""Control of a hand: from contact goals to desired joint states."""

from typing import Any

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.assignment import palm_turn, turned_within
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.palm_base import PalmCarrier
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.systems.differential_kinematics import DifferentialKinematics
from drake_pregrasp.systems.fingertip_goal_shaper import FingertipGoalShaper
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor
from drake_pregrasp.systems.grasp_sequencer import GraspSequencer
from drake_pregrasp.systems.joint_reference import JointReference
from drake_pregrasp.systems.palm_posture import ArmPosture, CarrierPosture

POSTURE_GAIN = 5.0
"""Gain with which joints follow their nominal posture, in 1/s."""

_POSITION_ONLY = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])


class HandController(Diagram):
    """Follows contact goals with fingertips; grasps and lifts on command.

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
        - V_WO_held
        - X_WU

    The ports are those of the systems inside, which document them. The planner is connected to
    `fingertip_targets`, `contact_status`, `X_WO_estimated`, `V_WO_estimated` and, optionally,
    `tracking_status`; `obstacles` is optional too, and `close` is the command. The hand's plant is
    connected to `hand_state` and `net_actuation`, and to `desired_state` (`JointReference`).
    Observers may use `p_GT` (`FingertipGoalShaper`), `p_WT` and `f_T_W` (`FingertipSensor`), `X_WG`
    and `grasp_report` (`GraspSequencer`). The planner may use `X_WH` and `X_WU` (`CarrierPosture`
    or `ArmPosture`) for the reach and the measures of the fingers, `hold_contacts`
    (`GraspSequencer`), which holds its goals while the hand grasps, and `V_WO_held`
    (`GraspSequencer`), so that its estimate follows the object that the hand moves.

    Goals are predicted ahead by the control period, in which the reference moves to its new value,
    and by the plant's time step, because the plant samples desired states at its start.

    The attribute `initial` holds the initial positions of the hand, shape (nq,): over the object,
    raised, and turned toward its contacts.

    Args:
        config: Configuration of the grasp.
        hand: Model of the hand.
        object_solid: The object in O.
        mass: Mass of the object, in kg.
        p_OCoM: Centre of mass of the object in O, shape (3,), in metres.
        fixed: Solids in W that fingertips avoid, such as the table.
        X_WO: Initial pose of the object.
        p_OC: Initial contacts in O, in the order of the fingers, shape (n, 3), in metres.
        target_period: Seconds between ticks of the planner.
        plant_time_step: Time step of the hand's plant, in seconds.

    Raises:
        InvalidArgumentError: If an argument or a field of `config` is out of its range, an initial
            contact is on a face that is forbidden to its finger, or an arm cannot hold the palm
            over the object.
    """

    initial: FloatArray

    def __init__(
        self,
        config: GraspConfig,
        hand: HandModel,
        *,
        object_solid: SignedDistance,
        mass: float,
        p_OCoM: FloatArray,
        fixed: list[Solid],
        X_WO: RigidTransform,
        p_OC: FloatArray,
        target_period: float,
        plant_time_step: float,
    ) -> None:
        super().__init__()
        tip_frames = hand.kinematics.tip_frames
        for name, value, shape in (("p_OC", p_OC, (len(tip_frames), 3)), ("p_OCoM", p_OCoM, (3,))):
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
        hand.check_contacts(p_OC, object_solid.distance_and_gradient(p_OC)[1])
        builder = DiagramBuilder()
        settings = config.make_settings(hand.description.fingertips)
        R_LA = hand.X_LA.rotation().matrix()
        raised = settings.approach_height * R_LA[:, 2]
        X_WG = RigidTransform(X_WO.rotation(), X_WO.translation() + raised)
        p_AC = hand.around_axis(p_OC, X_WO.rotation().matrix(), p_OCoM)
        yaw_range = hand.yaw_range(config.yaw_range)
        yaw = turned_within(palm_turn(p_AC, hand.azimuths, 0.0), yaw_range)
        self.initial = hand.home(X_WG @ p_OCoM, yaw)
        shaper = builder.AddNamedSystem(
            "fingertip_goal_shaper",
            FingertipGoalShaper(
                config,
                tip_frames=tip_frames,
                tip_radius=hand.tip_radii,
                object_solid=object_solid,
                fixed=fixed,
                p_GT=(X_WG.inverse() @ hand.tips_at(self.initial).T).T,
                finger_azimuths=hand.azimuths,
                target_period=target_period,
                lead=config.period + plant_time_step,
                withdrawn_radii=hand.withdrawn_radii,
                X_LA=hand.X_LA,
                p_OCoM=p_OCoM,
            ),
        )
        palm: dict[str, Any] = {
            "tip_frames": tip_frames,
            "finger_azimuths": hand.azimuths,
            "period": config.period,
            "yaw_range": yaw_range,
            "X_LA": hand.X_LA,
            "p_OCoM": p_OCoM,
        }
        base = hand.base
        masks = dict.fromkeys(tip_frames, _POSITION_ONLY)
        posture: CarrierPosture | ArmPosture
        if isinstance(base, PalmCarrier):
            home = hand.home(np.zeros(3), yaw)
            posture = CarrierPosture(**palm, home=home, carrier=base.joints, gain=POSTURE_GAIN)
            builder.AddNamedSystem("carrier_posture", posture)
            goals: tuple[System, str] = (shaper, "tip_goals:desired_cartesian_poses")
        else:
            posture = ArmPosture(
                **palm,
                palm_frame=base.palm_frame,
                X_GP=base.X_GP,
                home=base.placed(hand.fingers_home),
                p_WG=X_WG @ p_OCoM,
                yaw=yaw,
                lead=config.period + plant_time_step,
            )
            builder.AddNamedSystem("arm_posture", posture)
            masks[base.palm_frame] = np.ones(6)
            goals = (posture, "goals:desired_cartesian_poses")
        kinematics = builder.AddNamedSystem(
            "differential_kinematics",
            DifferentialKinematics(
                hand.make_scene(object_solid, fixed),
                masks=masks,
                posture_gain=POSTURE_GAIN,
                acceleration=config.tip_acceleration,
                period=config.period,
            ),
        )
        reference = builder.AddNamedSystem(
            "joint_reference",
            JointReference(
                hand.kinematics,
                period=config.period,
                initial=self.initial,
                plant_time_step=plant_time_step,
            ),
        )
        sensor = builder.AddNamedSystem("fingertip_sensor", FingertipSensor(hand.kinematics))
        sequencer = builder.AddNamedSystem(
            "grasp_sequencer",
            GraspSequencer(
                config,
                fingertips=hand.description.fingertips,
                mass=mass,
                p_OCoM=p_OCoM,
                object_solid=object_solid,
                efforts=hand.kinematics.efforts,
                palm_axis=R_LA[:, 2],
            ),
        )
        for source, names, targets in (
            (shaper, "tip_goals", [posture]),
            (*goals, [kinematics]),
            (shaper, "v_WT", [kinematics]),
            (sequencer, "X_WG V_WG", [shaper, posture, kinematics]),
            (sequencer, "standoffs hold_contacts", [shaper]),
            (sequencer, "fingers_hold", [shaper, kinematics]),
            (posture, "X_WU", [shaper]),
            (posture, "nominal_posture", [kinematics]),
            (reference, "position velocity", [kinematics]),
            (kinematics, "commanded_velocity", [reference]),
            (kinematics, "blocked_finger", [sequencer]),
            (sequencer, "squeeze_forces:f_T_W force_limits", [reference]),
            (shaper, "contact_frames", [sequencer]),
            (sensor, "p_WT f_T_W J_WT", [sequencer]),
        ):
            connect(builder, source, names, *targets)
        for inputs, systems in (
            ("fingertip_targets", [shaper]),
            ("contact_status", [shaper, sequencer]),
            ("X_WO_estimated", [shaper, sequencer, posture, kinematics]),
            ("V_WO_estimated", [sequencer, kinematics]),
            ("close", [sequencer]),
            ("hand_state", [sensor, reference]),
            ("net_actuation", [sensor]),
            ("obstacles", [shaper, kinematics]),
            ("tracking_status", [shaper, sequencer]),
        ):
            export_inputs(builder, inputs, *systems)
        for system, outputs in (
            (reference, "desired_state"),
            (shaper, "p_GT"),
            (sensor, "p_WT f_T_W"),
            (sequencer, "X_WG"),
            (posture, "X_WH"),
            (sequencer, "hold_contacts grasp_report V_WO_held"),
            (posture, "X_WU"),
        ):
            export_outputs(builder, system, outputs)
        builder.BuildInto(self)
