"""The tables of a report in LaTeX, with booktabs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from novelty.errors import InputError
from novelty.io import write_text
from novelty.report.sweep.comparison import COLUMNS, compare
from novelty.report.sweep.runs import SweepRuns
from novelty.report.sweep.studies import Study, studies
from novelty.report.sweep.summary import METRICS
from novelty.report.sweep.tables import ScoreCell, ScoreTable, comparison_table, score_table
from novelty.report.tables import Table

SYMBOLS = {"kappa": r"$\kappa$", "cramers_v": "$V$", "uncertainty": "$U$", "f1": "$F_1$", "iou": "IoU"}
"""The metrics in mathematics."""

SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
SPECIAL |= {character: f"\\{character}" for character in "&%$#_{}"}
SPECIAL |= {"κ": r"$\kappa$", "–": "--", "→": r"$\rightarrow$"}


def write_sweep_latex(path: str | Path, runs: SweepRuns, other: SweepRuns | None = None) -> None:
    r"""Write one table per factor and score, and of two sweeps their paired differences; needs `\usepackage{booktabs}`.

    Raises:
        InputError: No run has scores, the sweeps have no run in common, or the file cannot be written.
    """
    cut = [study for study in studies(runs) if study.scored]
    if not cut:
        raise InputError(
            f"{runs.root}: no run has scores, so there are no tables; its pairs had no ground truth."
        )
    tables = ["% needs \\usepackage{booktabs}"]
    tables += [_scores(score_table(study, metric), study) for study in cut for metric in METRICS]
    if other is not None:
        comparison = compare(runs, other, cut[0].series)
        tables += [
            _plain(comparison_table(comparison, column), f"{column}: {other.root.name} less {runs.root.name}")
            for column in COLUMNS
        ]
    write_text(path, "\n\n".join(tables) + "\n")


def _scores(scores: ScoreTable, study: Study) -> str:
    corner = _math(_escaped(scores.corner))
    lines = [_line([_math(_escaped(name)), *(_score(cell) for cell in cells)]) for name, cells in scores.rows]
    against = f" against {corner}" if corner else ""
    caption = f"{SYMBOLS[scores.metric]}{against}: mean and 95\\,\\% interval over the pairs."
    if study.pooled:
        caption += f" Averaged over {_escaped(', '.join(factor.label for factor in study.pooled))}."
    return _table("l" + "r" * len(scores.columns), [corner, *map(_escaped, scores.columns)], lines, caption)


def _score(cell: ScoreCell | None) -> str:
    if cell is None:
        return "--"
    mean = f"\\textbf{{{cell.mean}}}" if cell.best else cell.mean
    return f"{mean} {{\\scriptsize [{cell.interval.replace(' to ', ', ')}]}}" if cell.interval else mean


def _plain(table: Table, caption: str) -> str:
    form = "".join("r" if column.numeric else "l" for column in table.columns)
    lines = [_line(map(_escaped, row.cells)) for row in table.rows]
    return _table(form, [_escaped(column.name) for column in table.columns], lines, _escaped(caption))


def _table(form: str, heading: Sequence[str], lines: Sequence[str], caption: str) -> str:
    return "\n".join(_environment(form, heading, lines, caption))


def _environment(form: str, heading: Sequence[str], lines: Sequence[str], caption: str) -> Iterator[str]:
    yield "\\begin{table}\n  \\centering"
    yield f"  \\caption{{{caption}}}"
    yield f"  \\begin{{tabular}}{{{form}}}\n    \\toprule"
    yield f"    {_line(heading)}\n    \\midrule"
    yield from (f"    {line}" for line in lines)
    yield "    \\bottomrule\n  \\end{tabular}\n\\end{table}"


def _line(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _escaped(text: str) -> str:
    return "".join(SPECIAL.get(character, character) for character in text)


def _math(text: str) -> str:
    """K_max as a symbol."""
    return re.sub(r"K\\_max", r"$K_{\\max}$", text)
