"""The commands that make a report: `reproduce`, `study`, `sweep` and `bench`."""

import argparse
import time
from typing import Any

from drake_pregrasp.studies.bench.bench import bench
from drake_pregrasp.studies.faults import command as faults
from drake_pregrasp.studies.gallery import make_gallery
from drake_pregrasp.studies.grasp_pictures import picture_grasps
from drake_pregrasp.studies.lookahead import study_lookahead
from drake_pregrasp.studies.many_runs import names_of
from drake_pregrasp.studies.published import SCENARIOS
from drake_pregrasp.studies.reproduce import reproduce
from drake_pregrasp.studies.shapes import study_shapes
from drake_pregrasp.studies.static_versus_dynamic import command as static_versus_dynamic
from drake_pregrasp.studies.step_bar import step_bar
from drake_pregrasp.studies.sweep import command as sweep

_STUDIES = {
    "gallery": (make_gallery, "pictures of the shipped scenarios, with their measures"),
    "grasps": (picture_grasps, "pictures of the shipped hands"),
    "lookahead": (study_lookahead, "what goals for a later pose gain on fast objects"),
    "shapes": (study_shapes, "whether contacts stay where they may be, on ten shapes"),
}


def add_commands(commands: "argparse._SubParsersAction[Any]") -> None:
    """Adds the commands to those of `drake-pregrasp`."""
    reproducer = commands.add_parser("reproduce", help="reproduce the paper's tables and figures")
    reproducer.set_defaults(command=_reproduce)
    reproducer.add_argument(
        "--out", default="reproduction", metavar="FOLDER", help="where the report goes"
    )
    reproducer.add_argument(
        "--cases",
        default=",".join(SCENARIOS),
        metavar="a,b,...",
        help="which; %(default)s if not set",
    )

    student = commands.add_parser("study", help="measure what a feature gains")
    studies = student.add_subparsers(required=True, metavar="NAME", dest="study")
    for name, (_, text) in _STUDIES.items():
        study = studies.add_parser(name, help=text)
        study.set_defaults(command=_study)
        study.add_argument(
            "--out", default=f"study_{name}", metavar="FOLDER", help="where the report goes"
        )
    faults.add_command(studies)
    static_versus_dynamic.add_command(studies)
    sweep.add_command(commands)

    bencher = commands.add_parser("bench", help="measure how long planning takes")
    bencher.set_defaults(command=_bench)
    bencher.add_argument(
        "--out",
        default="bench",
        metavar="FOLDER",
        help="where the report goes; %(default)s if not set",
    )
    bencher.add_argument("--quick", action="store_true", help="leave out what takes long")


def _reproduce(options: argparse.Namespace) -> int:
    cases = names_of(options.cases)
    start = time.perf_counter()
    with step_bar() as on_progress:
        report = reproduce(options.out, cases, on_progress=on_progress)
    print(f"reproduced in {(time.perf_counter() - start) / 60:.1f} minutes")
    print(f"report in {report}: open it in a browser")
    return 0


def _study(options: argparse.Namespace) -> int:
    study, _ = _STUDIES[options.study]
    with step_bar() as on_progress:
        report = study(options.out, on_progress=on_progress)
    print(f"report in {report}")
    return 0


def _bench(options: argparse.Namespace) -> int:
    with step_bar() as on_progress:
        report = bench(options.out, quick=options.quick, on_progress=on_progress)
    print(f"report in {report}")
    return 0
