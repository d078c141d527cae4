"""Measures the time from sending a pose to receiving the command that follows from it.

    OPENBLAS_NUM_THREADS=1 sudo -E chrt -f 50 .venv/bin/python docs/interfaces/latency.py

A second process takes the place of camera and hand, and sends 100 poses a second. The planner and
the controller of the five-finger hand run between them. For your own hand, replace the
description, and the echo of the joints by their measured state.
"""

import multiprocessing
import time

import numpy as np
from drake import lcmt_scope
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, ZeroOrderHold

import drake_pregrasp as dp
from drake_pregrasp.interfaces.lcm import (
    ALLEGRO_CHANNEL,
    POSE_CHANNEL,
    AddCommandPublisher,
    AddPoseSubscriber,
    run_lcm_loop,
)

URL = "udpm://239.255.76.67:7667?ttl=0"  # Stays on this machine.
PERIOD, SECONDS, WARM_UP = 0.01, 10.0, 1.0


def camera_and_hand(results):
    """Sends poses, and puts the seconds until the first command after each into a queue."""
    lcm, commands, waits, sent = DrakeLcm(URL), [], [], 0.0
    lcm.Subscribe(ALLEGRO_CHANNEL, lambda data: commands.append(time.perf_counter()))
    start = time.perf_counter() + WARM_UP
    for k in range(round(SECONDS / PERIOD)):
        while (left := start + k * PERIOD - time.perf_counter()) > 0:
            lcm.HandleSubscriptions(int(1000 * left))
        if k > 0:
            waits.append(commands[0] - sent if commands else np.inf)
        commands.clear()
        angle = 0.5 * k * PERIOD
        message = lcmt_scope()
        message.utime, message.size = time.time_ns() // 1000, 7
        message.value = [0.05 * np.cos(angle), 0.05 * np.sin(angle), 0.05, 1.0, 0.0, 0.0, 0.0]
        sent = time.perf_counter()
        lcm.Publish(POSE_CHANNEL, message.encode())
    results.put(waits[round(WARM_UP / PERIOD) :])


box = dp.Box(size=[0.1, 0.1, 0.1], mass=0.4)
table = dp.HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0]))
surface = dp.box_surface(box.size, spacing=0.005, forbidden_faces=["+z", "-z"])
config = dp.GraspConfig(period=PERIOD)
hand = dp.HandModel(dp.load_hand("package://drake_pregrasp/five_finger_hand.yaml"))
limits = dp.hand_limits(hand.description, config)
planning = dp.PlannerConfig(period=PERIOD, static_duration=0.0, limits=limits)
p_OC = dp.ring_contacts(surface, 5)

builder, lcm = DiagramBuilder(), DrakeLcm(URL)
pose = AddPoseSubscriber(builder, lcm)
planner = dp.AddPregraspPlanner(
    builder, planning, surface, p_OC, fingertip_frames=hand.kinematics.tip_frames
)
controller = builder.AddSystem(
    dp.HandController(
        config,
        hand,
        object_solid=dp.BoxSolid(np.zeros(3), np.eye(3), np.array(box.size)),
        mass=box.mass,
        p_OCoM=surface.p_OCoM,
        fixed=[table],
        X_WO=RigidTransform([0.05, 0.0, 0.05]),
        p_OC=p_OC,
        target_period=PERIOD,
        plant_time_step=PERIOD,
    )
)
q = controller.initial
fingers = range(len(q) - 15, len(q))  # The last 15 joints; the others carry the palm.
command = AddCommandPublisher(builder, lcm, ALLEGRO_CHANNEL, fingers, q, period=PERIOD)
close = builder.AddSystem(ConstantVectorSource([0.0]))  # Only follow the object.
echo = builder.AddSystem(ZeroOrderHold(PERIOD, 2 * len(q)))  # In place of measured joints.
for source, target, names in (
    (pose, planner, "X_WO_measured measurement_time"),
    (planner, controller, "fingertip_targets contact_status X_WO_estimated V_WO_estimated"),
    (planner, controller, "tracking_status"),
    (controller, planner, "X_WH hold_contacts V_WO_held"),
    (controller, command, "desired_state"),
    (planner, command, "time_since_measurement"),
):
    for name in names.split():
        builder.Connect(source.GetOutputPort(name), target.GetInputPort(name))
builder.Connect(close.get_output_port(), controller.GetInputPort("close"))
builder.Connect(controller.GetOutputPort("desired_state"), echo.get_input_port())
builder.Connect(echo.get_output_port(), controller.GetInputPort("hand_state"))
diagram = builder.Build()

simulator = Simulator(diagram)
context = echo.GetMyMutableContextFromRoot(simulator.get_mutable_context())
context.SetDiscreteState(np.append(q, np.zeros(len(q))))
simulator.AdvanceTo(PERIOD)  # What numba compiles is compiled here.
processes = multiprocessing.get_context("fork")
results = processes.Queue()
camera = processes.Process(target=camera_and_hand, args=(results,))
camera.start()
run_lcm_loop(simulator, lcm, period=PERIOD, duration=SECONDS + WARM_UP)
camera.join()
waits = 1000 * np.array(results.get())
answered = waits[np.isfinite(waits)]
if not len(answered):
    raise SystemExit("no pose was answered before the next one: this machine is too slow or busy")
p50, p99 = np.percentile(answered, [50, 99], method="higher")
print(f"{len(answered)} of {len(waits)} poses answered before the next one")
print(f"these after {p50:.1f} ms (median) and {p99:.1f} ms (99th percentile)")
