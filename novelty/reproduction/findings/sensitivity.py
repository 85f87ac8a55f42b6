"""Section 3.6, Fig. 18: kappa against the number of components, over boxes of twelve sizes and twelve viewpoints."""

from __future__ import annotations

import statistics
from collections.abc import Container, Sequence

from novelty.evaluation import Interval, t_interval
from novelty.reproduction import printed
from novelty.reproduction.findings.finding import ALIKE, SECOND, Finding, weighed
from novelty.reproduction.findings.verdict import Condition, told
from novelty.reproduction.methods import CALIBRATED, PRINTED, Method
from novelty.reproduction.rows import Row, grouped, matching, order_curve
from novelty.reproduction.sensitivity import BOX_SIZE, VIEWPOINT


def best_orders(rows: Sequence[Row], experiment: str) -> Finding:
    """Whether kappa at K = 8 and 12 is above the mean of all other K, map by map."""
    what = {BOX_SIZE: "a box of twelve sizes", VIEWPOINT: "a person from twelve viewpoints"}[experiment]
    return weighed(
        f"Changes are found best with K = 8 and K = 12 (3.6, Fig. 18): {what}.",
        "K = 8 and 12",
        "; ".join(_best(rows, experiment, method) for method in (*PRINTED, CALIBRATED))
        + ". With the thresholds found here κ at K from 8 to 12 is "
        f"{told(_advantage(rows, experiment, CALIBRATED, range(8, 13)))} above that at the others",
        *(
            [
                Condition(
                    f"κ at 8 and 12 − at the others, {m.title}",
                    _advantage(rows, experiment, m, printed.BEST_ORDERS),
                    low=0,
                )
                for m in methods
            ]
            for methods in (PRINTED, SECOND)
        ),
    )


def alike_at_every_order(rows: Sequence[Row]) -> Finding:
    """The mean difference over all K, map by map."""
    curves = {name: [order_curve(rows, name, method) for method in PRINTED] for name in (BOX_SIZE, VIEWPOINT)}
    gaps = [first[k].mean - second[k].mean for first, second in curves.values() for k in first]
    return weighed(
        "EMD and structural matching give similar averages at every K (3.6, Fig. 18).",
        "shown in a plot",
        f"difference of mean κ between {min(gaps):+.2f} and {max(gaps):+.2f}, {statistics.mean(gaps):+.2f} on average",
        *(
            [
                Condition(name.replace("_", " "), _gap(rows, name, methods), low=-ALIKE, high=ALIKE)
                for name in (BOX_SIZE, VIEWPOINT)
            ]
            for methods in (PRINTED, SECOND)
        ),
    )


def _best(rows: Sequence[Row], experiment: str, method: Method) -> str:
    curve = order_curve(rows, experiment, method)
    best = max(curve, key=lambda k: curve[k].mean)
    named = ", ".join(f"{curve[k].mean:.2f} at {k}" for k in (*printed.BEST_ORDERS, max(curve)))
    return f"{method.title} best at K = {best}, κ {curve[best].mean:.2f} ({named})"


def _advantage(rows: Sequence[Row], experiment: str, method: Method, orders: Container[int]) -> Interval:
    """Mean kappa at some orders minus that at the others, over the maps."""
    return t_interval(
        [
            statistics.mean(row.kappa for row in part if row.order in orders)
            - statistics.mean(row.kappa for row in part if row.order not in orders)
            for part in _maps(rows, experiment, method).values()
        ]
    )


def _gap(rows: Sequence[Row], experiment: str, methods: Sequence[Method]) -> Interval:
    first, second = (
        {
            place: statistics.mean(row.kappa for row in part)
            for place, part in _maps(rows, experiment, m).items()
        }
        for m in methods
    )
    return t_interval([first[place] - second[place] for place in first])


def _maps(rows: Sequence[Row], experiment: str, method: Method) -> dict[tuple[str, int], list[Row]]:
    """The rows of every map, one per prescribed K."""
    own = [row for row in matching(rows, experiment=experiment, method=method.key) if row.order]
    return grouped(own, lambda row: (row.varied, row.repetition))
