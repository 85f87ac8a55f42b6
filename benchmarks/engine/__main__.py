"""`python -m benchmarks.engine`: one table of what is measured, our time, the peer's, and the ratio.

Times are medians of alternating runs (ours, peer, ours, peer, ...), preparation of the inputs outside the clock, one
warm-up first. The clouds are the tests' rooms.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
from collections.abc import Callable, Iterable, Iterator

import torch

from benchmarks.engine import fixed_order, orders
from benchmarks.engine.devices import cuda_beside_cpu
from benchmarks.engine.precision import precision
from benchmarks.engine.timing import HEADER, Row, alternate
from gmmtorch import PointClouds, fit_mdl, greedy_removals
from novelty.environment import machine
from tests.gmmtorch.test_removals import changed_rooms
from tests.helpers import room
from tests.reference import transport as plain


def removals(runs: int, num_pairs: int = 100) -> Iterator[Row]:
    """Algorithm 2 for pairs of mixtures, against the plain loop over POT."""
    a, b, cost = changed_rooms(0, num_pairs, 16, 3)
    times = alternate(
        lambda: greedy_removals(*(torch.from_numpy(x) for x in (a, b, cost))),
        lambda: [plain.greedy_removals(*pair) for pair in zip(a, b, cost, strict=True)],
        runs,
    )
    yield Row(f"greedy EMD of {num_pairs} pairs, K = 16", times[0], "plain loop over POT", times[1])


def memory(num_points: int) -> Iterator[str]:
    """Peak resident memory above the input for a search of the order over one large cloud; to be measured first."""
    fit_mdl(PointClouds.from_list([room(1_000)]), 3)  # the compiled loops are loaded
    clouds = PointClouds.from_list([room(num_points)])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    fit_mdl(clouds, 20, max_iterations=2)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    yield f"peak memory above the input, order search over {num_points} points: {grown:.0f} MiB"


def parts(runs: int, sizes: tuple[int, ...], small: bool) -> dict[str, Callable[[], Iterable[object]]]:
    """The parts of the table by name; `small` asks for tiny inputs, to see whether it runs."""
    if small:
        return {
            "memory": lambda: memory(50_000),
            "em": lambda: fixed_order.one_cloud(1, (10_000,)),
            "batches": lambda: fixed_order.batches(1, 2, 3),
            "order": lambda: orders.beside_peers(500, 2),
            "coarse": lambda: orders.coarse_to_fine(5_000, 1, 1),
            "kmax": lambda: orders.many_orders(500),
            "removals": lambda: removals(1, 5),
            "precision": lambda: precision((1_000,), 2),
            "devices": lambda: cuda_beside_cpu(1, (1_000,), 2),
        }
    return {
        "memory": lambda: memory(2_000_000),
        "first-use": fixed_order.first_use,
        "em": lambda: fixed_order.one_cloud(runs, sizes),
        "batches": lambda: fixed_order.batches(runs),
        "order": lambda: (row for n in (10_000, 30_000) for row in orders.beside_peers(n, 10)),
        "coarse": lambda: (row for n in (100_000, 1_000_000) for row in _coarse(n, runs)),
        "kmax": lambda: orders.many_orders(30_000),
        "removals": lambda: removals(runs),
        "precision": lambda: precision(sizes, 10),
        "devices": lambda: cuda_beside_cpu(runs, (30_000, 100_000, 1_000_000)),
    }


def _coarse(n: int, runs: int) -> Iterator[Row]:
    large = n > 100_000
    return orders.coarse_to_fine(n, 1 if large else 10, 1 if large else runs)


def main() -> None:
    """Print the table."""
    known = list(parts(1, (), False))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5, help="alternating runs of each comparison")
    parser.add_argument("--only", choices=known, action="append", help="a part of the table; repeatable")
    parser.add_argument(
        "--sizes", type=int, nargs="+", default=[10_000, 30_000, 100_000], help="points for EM"
    )
    parser.add_argument(
        "--small", action="store_true", help="tiny inputs: whether it runs, no figures to quote"
    )
    given = parser.parse_args()
    command = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    print(f"{machine()['processor']}, {torch.get_num_threads()} threads, torch {torch.__version__}, "
          f"gmmtorch {commit or 'installed'}\n{HEADER}")  # fmt: skip
    for name, lines in parts(given.runs, tuple(given.sizes), given.small).items():
        if given.only is None or name in given.only:
            for line in lines():
                print(line, flush=True)


if __name__ == "__main__":
    main()
