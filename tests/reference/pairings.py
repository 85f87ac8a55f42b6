"""The probability of error of two thresholds (section 3.2), counted one pairing at a time."""


def p_err(valid, invalid, node_threshold, arc_threshold):
    """Half of the invalid pairings that pass both thresholds, and half of the valid ones that do not."""

    def passed(rows):
        return sum(d < node_threshold and delta < arc_threshold for d, delta in rows) / len(rows)

    return 0.5 * passed(invalid) + 0.5 * (1 - passed(valid))
