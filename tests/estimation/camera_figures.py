"""Figures of depth cameras and of the filter behind them, on meshes at random poses.

The pictures are rendered. A pose is judged by the surface: it is within a distance of the true one
if all points of the surface are, so that symmetric objects need no special treatment.
"""

import argparse
import time

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from drake_pregrasp.config.planner_config import filter_noise
from drake_pregrasp.estimation.pose_belief import first_belief
from drake_pregrasp.estimation.surface_alignment import SurfacePoints
from tests.estimation.camera_scene import CONFIG, RATE, SPEED, Scene
from tests.estimation.test_contact_measurement import squared_errors

MESHES = ("carton", "can", "bottle", "drill", "mug", "hammer", "bracket")
MOVED = ("drill", "mug", "hammer", "bracket")


def aligned(scene: Scene, rng: np.random.Generator) -> float:
    """Returns the processor time that 1,000 points take, in seconds: the median of 50."""
    X_WO = scene.resting(rng)
    p_OQ = trimesh.sample.sample_surface(scene.mesh, 1000, seed=2)[0]
    points, times = SurfacePoints.seen((X_WO @ p_OQ.T).T, CONFIG.point_std), []
    std = np.sqrt(np.repeat(filter_noise(CONFIG).variances, 3))
    for _ in range(50):
        start = time.thread_time()
        scene.seen.align(
            scene.solid.surface, points, X_WO.rotation().matrix(), X_WO.translation() + 0.003, std
        )
        times.append(time.thread_time() - start)
    return float(np.median(times))


def registered(name: str, cameras: int, options: argparse.Namespace) -> str:
    """Returns how many poses of a mesh are registered, and what is wrong with the others.

    A wrong pose is sure of itself if its turn to the true one is beyond three standard deviations.
    """
    scene, rng = Scene(name, cameras), np.random.default_rng(options.seed)
    near, alike, sure, times = 0, 0, 0, []
    for index in range(options.count):
        X_WO = scene.resting(rng)
        p_WQ, start = scene.points(X_WO, options.seed + index), time.process_time()
        found = scene.seen.measured(p_WQ, 0.0, None)
        times.append(time.process_time() - start)
        if scene.off(X_WO, found.R_WO, found.p_WO) < 3e-3:
            near += 1
            continue
        true = scene.fitting(p_WQ, X_WO.rotation().matrix(), X_WO.translation())
        alike += true < scene.fitting(p_WQ, found.R_WO, found.p_WO) + 0.002
        turn = Rotation.from_matrix(X_WO.rotation().matrix() @ found.R_WO.T).as_rotvec()
        P = first_belief(found, scene.seen.noise).P[0, :3, :3]
        sure += turn @ turn > 3 * np.sqrt(turn @ P @ turn)
    return (
        f"{near} of {options.count} within 3 mm; of the others, {alike} fit as well as the true"
        f" pose, and {sure} are sure of themselves; at most {max(times, default=0):.2f} s"
    )


def main() -> None:
    """Prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="seed of the poses")
    parser.add_argument("--count", type=int, default=100, help="number of poses of each mesh")
    parser.add_argument("--motions", type=int, default=5, help="number of motions of each mesh")
    parser.add_argument("--runs", type=int, default=100, help="number of runs for the NEES")
    parser.add_argument("--meshes", default=",".join(MESHES), help="names of the meshes")
    options = parser.parse_args()
    for name in filter(None, options.meshes.split(",")):
        for cameras in (1, 2):
            print(f"{name}, cameras {cameras}: {registered(name, cameras, options)}", flush=True)
        scene, rng = Scene(name), np.random.default_rng(options.seed)
        print(f"  1,000 points {1e3 * aligned(scene, rng):.2f} ms")
        for cameras in (1, 2) if name in MOVED and options.motions else ():
            scene, rng = Scene(name, cameras), np.random.default_rng(options.seed)
            runs = [scene.tracked(rng) for _ in range(options.motions)]
            distances = np.concatenate([run.distances for run in runs])
            angles = np.degrees(np.concatenate([run.angles for run in runs]))
            print(
                f"  cameras {cameras}, at {SPEED} m/s: 95 % within"
                f" {1e3 * np.quantile(distances, 0.95):.2f} mm and"
                f" {np.quantile(angles, 0.95):.2f}°; camera and filter at {RATE:g} Hz:"
                f" {np.median([run.load for run in runs]):.2f} s/s",
                flush=True,
            )
    if options.runs:
        seeds = range(options.seed, options.seed + options.runs)
        mean = np.mean([squared_errors(seed, rests=False) for seed in seeds], axis=0)
        for words, ticks in (
            ("before", slice(5, 15)),
            ("in", slice(15, 20)),
            ("after", slice(20, 30)),
        ):
            pose, offset = mean[ticks].mean(axis=0)
            print(f"NEES {words} touches: pose {pose:.2f}, offset {offset:.2f}")


if __name__ == "__main__":
    main()
