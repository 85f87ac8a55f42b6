"""What `novelty sweep` says of its plan and of what it has done."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from novelty.cli.sweep import _show_plan, _show_summary
from novelty.sweep.run import Summary


@pytest.mark.parametrize(("sizes", "told"), [((8, 8), "8"), ((3, 8, 5), "3 to 8"), ((), "0")])
def test_a_plan_says_one_number_where_all_batches_are_alike(sizes, told, capsys):
    batches = [SimpleNamespace(num_runs=size) for size in sizes]
    _show_plan(
        SimpleNamespace(pairs=(), settings=(), num_runs=9, batches=batches, seats=1, seconds=1.0, memory=1e9)
    )
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "runs per batch" in line]
    assert line.split("batch")[1].strip() == told


@pytest.mark.parametrize(
    ("count", "sentences"),
    [
        (1, ("1 run in 1 s", "1 was done before", "1 run has no answer", "1 run is left.")),
        (2, ("2 runs in 1 s", "2 were done before", "2 runs have no answer", "2 runs are left.")),
    ],
)
def test_a_summary_counts_in_the_right_number(count, sentences, capsys):
    _show_summary(Summary(3 * count, count, count, count, 0, 1.0, ()), Path("runs"))
    told = " ".join("".join(capsys.readouterr()).split())
    for sentence in sentences:
        assert sentence in told
