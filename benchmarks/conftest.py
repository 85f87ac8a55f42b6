"""Idle threads must not spin while peers are timed; it has to be said before torch is imported."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
