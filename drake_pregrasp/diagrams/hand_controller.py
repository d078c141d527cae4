"""Control of a hand: from contact goals to desired joint states."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder

from drake_pregrasp.arrays import FloatArray
from drake_pregrasp.config.grasp_config import GraspConfig
from drake_pregrasp.contacts.assignment import palm_turn, turned_within
from drake_pregrasp.diagrams.hand_model import HandModel
from drake_pregrasp.diagrams.palm_meeting import meeting_settings
from drake_pregrasp.diagrams.wiring import connect, export_inputs, export_outputs
from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.fast.kernels import Kernels
from drake_pregrasp.geometry.solids import SignedDistance, Solid
from drake_pregrasp.systems.differential_kinematics import DifferentialKinematics
from drake_pregrasp.systems.fingertip_sensor import FingertipSensor
from drake_pregrasp.systems.grasp_sequencer import GraspSequencer
from drake_pregrasp.systems.hand_goal_shaper import HandGoalShaper
from drake_pregrasp.systems.interception_planner import InterceptionPlanner


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
        - p_WO_covariance
        - camera_offset
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
        - touching
        - X_WU
        - catch_certificate
        - late_fingers

    The ports are those of the systems inside, which document them. The planner is connected to
    `fingertip_targets`, `contact_status`, `X_WO_estimated`, `V_WO_estimated` and, optionally,
    `tracking_status`, `p_WO_covariance` and `camera_offset`; `obstacles` is optional too, and
    `close` is the command. The hand's plant is connected to `hand_state` and `net_actuation`, and
    to `desired_state` (`DifferentialKinematics`). Observers may use `p_GT` (`HandGoalShaper`),
    `p_WT` and `f_T_W` (`FingertipSensor`), `X_WG` and `grasp_report` (`GraspSequencer`), and
    `catch_certificate` (`InterceptionPlanner`). The planner may use `X_WH` and `X_WU`
    (`HandGoalShaper`) for the reach and the measures of the fingers, `hold_contacts`
    (`GraspSequencer`), which holds its goals while the hand grasps, `V_WO_held`, `p_WT` and
    `touching`, so that its estimate follows the object that the hand moves and touches, and
    `late_fingers`.

    In a control tick, `InterceptionPlanner` plans the meeting with the object while the hand
    approaches. `GraspSequencer` decides on the phase and what it commands, `HandGoalShaper`
    moves the goals of fingertips and palm, and `DifferentialKinematics` moves the joints after
    them. `FingertipSensor` measures where the fingertips are and what they press with.

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
        has_sampled_outputs: Whether its actuation is that of its last time step, as for
            `FingertipSensor`.
        gravity: Acceleration of the object along -z of W until the hand has gripped it, in m/s².
        diffusion: Spectral density of its random acceleration, in m²/s³.
        kernels: Implementation of the kinematics; that of `default_kernels` by default.
        yaw: Initial yaw of the palm about z of its approach, in radians; by default that of
            `palm_turn` at the initial contacts.
        yaw_slack: The slack of `palm_turn`, by which the yaw may be off before the palm turns, in
            radians.

    Raises:
        InvalidArgumentError: If an argument or a field of `config` is out of its range, an initial
            contact is on a face that is forbidden to its finger, an arm cannot hold the palm over
            the object, or a link starts inside of `fixed`.
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
        has_sampled_outputs: bool = False,
        gravity: float = 0.0,
        diffusion: float = 0.0,
        kernels: Kernels | None = None,
        yaw: float | None = None,
        yaw_slack: float = 0.0,
    ) -> None:
        super().__init__()
        _check(config, hand, mass=mass, p_OCoM=p_OCoM, p_OC=p_OC, plant_time_step=plant_time_step)
        hand.check_contacts(p_OC, object_solid.distance_and_gradient(p_OC)[1])
        settings = config.make_settings(hand.description.fingertips)
        R_LA = hand.X_LA.rotation().matrix()
        turns_from = X_WO.rotation().matrix() if hand.pans else None
        raised = settings.approach_height * R_LA[:, 2]
        X_WG = RigidTransform(X_WO.rotation(), X_WO.translation() + raised)
        yaw_range = hand.yaw_range(config.yaw_range)
        if yaw is None:
            p_AC = hand.around_axis(p_OC, X_WO.rotation().matrix(), p_OCoM)
            yaw = palm_turn(p_AC, hand.azimuths, 0.0)
        yaw = turned_within(yaw, yaw_range)
        self.initial = hand.home(X_WG @ p_OCoM, yaw)
        builder, scene = DiagramBuilder(), hand.make_scene(object_solid, fixed, kernels)
        scene.check_start(self.initial)
        object_solid = scene.kernels.solid(object_solid)
        sequencer = builder.AddNamedSystem(
            "grasp_sequencer",
            GraspSequencer(
                config,
                fingertips=hand.description.fingertips,
                mass=mass,
                p_OCoM=p_OCoM,
                object_solid=object_solid,
                efforts=hand.kinematics.efforts,
                stiffness=hand.kinematics.level_stiffness(self.initial),
                least_stiffness=hand.kinematics.least_stiffness(self.initial),
                palm_axis=R_LA[:, 2],
                R_WO=turns_from,
                gravity=gravity,
            ),
        )
        shaper = builder.AddNamedSystem(
            "hand_goal_shaper",
            HandGoalShaper(
                config,
                tip_frames=hand.kinematics.tip_frames,
                tip_radius=hand.tip_radii,
                object_solid=object_solid,
                fixed=fixed,
                p_GT=(X_WG.inverse() @ hand.tips_at(self.initial).T).T,
                finger_azimuths=hand.azimuths,
                withdrawn_radii=hand.withdrawn_radii,
                target_period=target_period,
                yaw=yaw,
                yaw_range=yaw_range,
                yaw_slack=yaw_slack,
                lead=config.period + plant_time_step,
                X_LA=hand.X_LA,
                R_WO=turns_from,
                p_OCoM=p_OCoM,
                jaws=hand.description.jaws,
                kernels=scene.kernels,
            ),
        )
        kinematics = builder.AddNamedSystem(
            "differential_kinematics",
            DifferentialKinematics(
                scene,
                base=hand.base,
                home=hand.fingers_home,
                initial=self.initial,
                yaw_range=yaw_range,
                acceleration=config.tip_acceleration,
                period=config.period,
                plant_time_step=plant_time_step,
                feeds_inertia=gravity > 0,
            ),
        )
        sensor = builder.AddNamedSystem(
            "fingertip_sensor",
            FingertipSensor(scene.hand, plant_time_step, is_sampled=has_sampled_outputs),
        )
        R_WO = X_WO.rotation().matrix()
        meeting = meeting_settings(
            config, hand, self.initial, object_solid, mass, p_OCoM, R_WO, gravity, diffusion
        )
        interception = builder.AddNamedSystem(
            "interception_planner",
            InterceptionPlanner(
                meeting,
                R_AW=R_LA.T,
                R_WO=turns_from,
                p_OCoM=p_OCoM,
                p_WL=X_WG @ p_OCoM,
                commitment=settings.closing_duration,
                predicts=config.meeting.predicts,
                period=config.period,
                kernels=scene.kernels,
            ),
        )
        _connect(builder, sequencer, shaper, kinematics, sensor, interception)
        builder.BuildInto(self)


def _check(
    config: GraspConfig,
    hand: HandModel,
    *,
    mass: float,
    p_OCoM: FloatArray,
    p_OC: FloatArray,
    plant_time_step: float,
) -> None:
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


def _connect(
    builder: DiagramBuilder,
    sequencer: GraspSequencer,
    shaper: HandGoalShaper,
    kinematics: DifferentialKinematics,
    sensor: FingertipSensor,
    interception: InterceptionPlanner,
) -> None:
    """Connects the systems to each other, and exports the ports of `HandController` in order."""
    connect(builder, sequencer, "command", shaper, kinematics)
    connect(builder, shaper, "goals", kinematics)
    connect(builder, shaper, "contacts", sequencer)
    connect(builder, kinematics, "blocked_finger", sequencer)
    connect(builder, sensor, "p_WT f_T_W J_WT", sequencer)
    export_inputs(builder, "fingertip_targets contact_status", shaper)
    connect(builder, sequencer, "X_WG grasp_report", interception)
    connect(builder, interception, "approach", sequencer)
    export_inputs(builder, "X_WO_estimated V_WO_estimated", sequencer, interception)
    export_inputs(builder, "close", sequencer)
    export_inputs(builder, "hand_state", sensor, kinematics)
    export_inputs(builder, "net_actuation", sensor)
    export_inputs(builder, "obstacles", shaper, kinematics)
    export_inputs(builder, "tracking_status", sequencer, interception)
    export_inputs(builder, "p_WO_covariance", interception)
    export_inputs(builder, "camera_offset", sequencer)
    export_outputs(builder, kinematics, "desired_state")
    export_outputs(builder, shaper, "p_GT")
    export_outputs(builder, sensor, "p_WT f_T_W")
    export_outputs(builder, sequencer, "X_WG")
    export_outputs(builder, shaper, "X_WH")
    export_outputs(builder, sequencer, "hold_contacts grasp_report V_WO_held touching")
    export_outputs(builder, shaper, "X_WU")
    export_outputs(builder, interception, "catch_certificate")
    export_outputs(builder, sequencer, "late_fingers")
