"""The rehearsal leaves nothing for a compiler to do."""

from __future__ import annotations

import time

from monitor.service.warm_up import warm_up


def test_warm_up_compiles_everything():
    """After it the first step of a loop does not wait for a compiler."""
    warm_up()
    began = time.thread_time()
    warm_up()
    assert time.thread_time() - began < 5.0
