"""A labelled grid of pictures: a row for each arm, a column for each moment."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread

from drake_pregrasp.errors import InvalidArgumentError
from drake_pregrasp.simulation.output import reading_back

_INCHES_A_PICTURE = 3.0
_INCHES_A_LINE = 0.27


def plot_picture_grid(
    path: Path,
    pictures: Sequence[Sequence[Path]],
    *,
    rows: Sequence[str],
    columns: Sequence[str],
    captions: Sequence[Sequence[str]] | None = None,
) -> None:
    """Puts pictures into a grid.

    Args:
        path: Of the PNG to write.
        pictures: PNG files, all of one shape, a list for each row.
        rows: What stands beside the rows.
        columns: What stands above the columns.
        captions: What stands below each picture, nothing if not set.

    Raises:
        InvalidArgumentError: If there are not as many pictures or captions as rows and columns.
        OutputError: If a picture can't be read.
    """
    for name, cells in (("pictures", pictures), ("captions", captions or pictures)):
        lengths = [len(row) for row in cells]
        if not columns or not rows or lengths != [len(columns)] * len(rows):
            raise InvalidArgumentError(
                f"{name}: {len(rows)} rows of {len(columns)} are needed, not rows of {lengths}"
            )
    images = []
    for row in pictures:
        for file in row:
            with reading_back(file):
                images.append(imread(file))
    height, width = images[0].shape[:2]
    below = _INCHES_A_LINE * _lines(captions) if captions else 0.05
    figure = Figure(
        figsize=(
            0.6 + _INCHES_A_PICTURE * len(columns),
            0.3 + (_INCHES_A_PICTURE * height / width + below) * len(rows),
        ),
        layout="constrained",
    )
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(rows), len(columns), squeeze=False)
    for index, (axis, image) in enumerate(zip(axes.ravel(), images, strict=True)):
        row_index, column = divmod(index, len(columns))
        axis.imshow(image)
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_color("0.8")
        if row_index == 0:
            axis.set_title(columns[column], fontsize=12, parse_math=False)
        if column == 0:
            axis.set_ylabel(rows[row_index], fontsize=12, parse_math=False)
        if captions:
            axis.set_xlabel(captions[row_index][column], fontsize=11, parse_math=False)
    figure.savefig(path, dpi=130)


def _lines(captions: Sequence[Sequence[str]]) -> int:
    return max(len(text.splitlines()) for of_row in captions for text in of_row)
