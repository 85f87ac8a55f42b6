"""What agrees with the paper and what does not, decided by the rows and nothing else."""

from novelty.reproduction.findings.finding import Finding
from novelty.reproduction.findings.section import find
from novelty.reproduction.findings.verdict import Condition, Verdict, judged

__all__ = ["Condition", "Finding", "Verdict", "find", "judged"]
