"""Objects on belts and in the air, and a palm that could meet them."""

from dataclasses import replace

import numpy as np

from drake_pregrasp.grasping.interception import NUM_TIMES, MeetingSettings, choose_meeting
from drake_pregrasp.grasping.palm_paths import Meeting, PalmLimits, moved

FALL = np.array([0.0, 0.0, -9.81])
SETTINGS = MeetingSettings(
    limits=PalmLimits(
        lower=np.array([-1.5, -1.5, 0.0]),
        upper=np.array([1.5, 1.5, 2.0]),
        speed=np.full(3, 1.4),
        acceleration=np.full(3, 3.0),
    ),
    step=3.0 / NUM_TIMES,
    earliest=0.0,
    lateness=0.3,
    follow=1.0,
    stop=0.3,
    height=0.1,
    sideways=0.01,
    grip=15.0,
    gravity=np.zeros(3),
    diffusion=1e-6,
)
IN_AIR = replace(
    SETTINGS,
    limits=PalmLimits(
        lower=np.array([-1.5, -1.5, -1.0]),
        upper=np.array([1.5, 1.5, 1.5]),
        speed=np.full(3, 0.9 * 3.0),
        acceleration=np.full(3, 0.9 * 25.0),
    ),
    step=0.8 / NUM_TIMES,
    follow=0.13,
    stop=0.2,
    height=0.08,
    grip=100.0,
    gravity=FALL,
)
"""A carrier of 3 m/s and 25 m/s², with the shares of palm_limits, and a ball of 80 mm."""

REST = np.array([[0.0, 0.0, 0.2], np.zeros(3), np.zeros(3)])


def chosen(motion, palm=REST, settings=SETTINGS, now=0.0, kept=None, choose=choose_meeting):
    kept = kept or Meeting.at_rest(palm[0])
    return choose(palm - motion, np.array(motion), 1e-6, now, kept, settings)


def with_limits(settings=SETTINGS, **changes):
    return replace(settings, limits=replace(settings.limits, **changes))


def on_belt(speed, x=-0.8, y=0.0):
    return np.array([[x, y, 0.05], [speed, 0.0, 0.0], np.zeros(3)])


def plan_of(choice, palm, motion, now=0.0):
    times = choice.over, choice.time, choice.height
    return Meeting(now, *times, palm - motion, motion, follows=False, meets=True)


def throws_to_a_palm(count, seed):
    """Motions, in A of a palm from the side, of objects seen for 0.15 s, and the palm at rest.

    They are tossed from 1 to 1.5 m away to a place 0.4 m higher, where they would be after 0.6 to
    0.8 s, and miss it by a standard deviation of 3 cm. The palm waits on the way of the mean throw.
    """
    random, R_AW = np.random.default_rng(seed), np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    palm = np.array([[-0.357, 0.0, 0.376], np.zeros(3), np.zeros(3)]) @ R_AW.T
    for _ in range(count):
        distance, flight = random.uniform(1.0, 1.5), random.uniform(0.6, 0.8)
        way = np.array([distance, 0.0, 0.4])
        start, v = random.normal(0, 0.03, 3) - way, way / flight - flight / 2 * FALL
        yield moved(np.array([start, v, FALL]), 0.15) @ R_AW.T, palm


def random_throws(count, seed):
    """Motions of objects on belts and in the air, palms, and settings with various limits."""
    random = np.random.default_rng(seed)
    for throw in range(count):
        flies, a = throw % 2, FALL if throw % 2 else np.zeros(3)
        v = random.uniform([-0.5, -0.5, -1.0], [1.5, 0.5, 3.5]) * [1, 1, flies]
        x = random.uniform([-1.6, -0.5, 0.05], [0.2, 0.5, 0.6])
        bounds = {
            "speed": random.uniform(0.8, 4, 3),
            "acceleration": random.uniform(3, 40, 3),
            "lower": np.array([-1.5, -1.5, random.choice([0.0, -3.0])]),
            "upper": np.array([1.5, 1.5, random.choice([0.8, 2.0])]),
        }
        settings = replace(
            with_limits(**bounds),
            grip=random.uniform(5, 40),
            follow=random.uniform(0.1, 0.8),
            lateness=random.choice([-100.0, 0.3, 100.0]),
            step=random.uniform(0.003, 0.015),
        )
        yield np.array([x, v, a]), REST + random.normal(0, 0.1, (3, 3)), settings
