"""Page, figure and JSON object of the ``report`` command, each made when it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec

from ph_post.report.result_line import result_lines, summary_view
from ph_post.report.traces import Picture
from ph_post.report.views import error_view

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ph_post.api.measurements import LogDiagnosis
    from ph_post.diff.compare import Comparison


class ReportProduct(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """How page, picture and JSON object of one input are made, and what there is to warn of.

    `notes` say what of a part program is not in the path that is shown; the JSON object has only `warnings`.
    `last` are the lines of the result, which a command ends with.
    """

    page: Callable[[], str]
    figure: Callable[[], Figure]
    view: Callable[[], dict[str, Any]]
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    last: tuple[str, ...] = ()


def motion_product(picture: Picture, notes: tuple[str, ...] = ()) -> ReportProduct:
    """Make a path or a program to be looked at."""
    from ph_post.report.motion_page import motion_page

    def figure() -> Figure:
        from ph_post.report.motion_figures import draw_picture

        return draw_picture(picture)

    return ReportProduct(
        page=lambda: motion_page(picture),
        figure=figure,
        view=lambda: picture_view(picture),
        warnings=picture.warnings,
        notes=notes,
        last=tuple(result_lines(picture.summary)),
    )


def picture_view(picture: Picture) -> dict[str, Any]:
    """Return what ``report --json`` prints of a path or a program."""
    before, after = picture.traces[0], picture.traces[-1]
    return {
        "kind": picture.kind,
        "windows": [
            {
                **mark.view,
                "error": {
                    "before": error_view(before.turning[number]),
                    "after": error_view(after.turning[number]),
                },
            }
            for number, mark in enumerate(picture.marks)
        ],
        **summary_view(picture.summary),
        "cycle_time": {"before": before.time, "after": after.time},
        "error_worst": {"before": error_view(before.worst), "after": error_view(after.worst)},
        "unchanged": len(picture.traces) == 1,
        "warnings": list(picture.warnings),
    }


def diff_product(found: Comparison) -> ReportProduct:
    """Make two programs to be looked at."""
    from ph_post.report.diff_page import diff_page
    from ph_post.report.diffs import diff_view

    def figure() -> Figure:
        from ph_post.report.diff_page import draw_diff

        return draw_diff(found)

    return ReportProduct(
        page=lambda: diff_page(found),
        figure=figure,
        view=lambda: {"kind": "comparison", **diff_view(found)},
        warnings=found.notes,
    )


def diagnosis_product(found: LogDiagnosis) -> ReportProduct:
    """Make a diagnosis to be looked at."""
    from ph_post.report.diagnoses import diagnosis_view, effort_units
    from ph_post.report.diagnosis_page import diagnosis_page

    efforts = effort_units(found.log)

    def figure() -> Figure:
        from ph_post.report.diagnosis_figures import draw_diagnosis

        return draw_diagnosis(found, efforts)

    return ReportProduct(
        page=lambda: diagnosis_page(found, found.log.name, efforts),
        figure=figure,
        view=lambda: {"kind": "diagnosis", **diagnosis_view(found, efforts)},
        warnings=found.log.warnings,
    )
