"""The worker processes of one machine, as the terminal sees them."""

import os
import signal
import sys
import time

import pytest

from novelty.sweep.folder import SweepFolder
from novelty.sweep.processes import Processes, WorkerOptions

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")


def test_ctrl_c_does_not_reach_a_process_that_is_still_starting(tmp_path, capfd):
    before = signal.pthread_sigmask(signal.SIG_BLOCK, set())
    processes = Processes(1, 1, WorkerOptions(SweepFolder(tmp_path)))
    (process, _), *_ = processes._seats
    try:
        for _ in range(10):
            os.kill(process.pid, signal.SIGINT)
            time.sleep(0.05)
        process.join(0.5)
        assert process.is_alive()
    finally:
        processes.close()
    assert process.exitcode == -signal.SIGTERM  # it can still be ended
    assert "Traceback" not in capfd.readouterr().err
    assert signal.pthread_sigmask(signal.SIG_BLOCK, set()) == before
