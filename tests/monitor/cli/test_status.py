"""The command `loopsight status`."""

from __future__ import annotations

import pytest

from monitor.adapters.zenoh_bus import open_session
from tests.monitor.cli.tools import refused
from tests.support.waiting import free_port


@pytest.mark.usefixtures("impatient")
def test_nobody_answers():
    """No router, and a router without a monitor: one line with the endpoint, exit 2."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    refused("status", "--connect", endpoint, names=endpoint)
    session = open_session("router", listen=[endpoint])
    try:
        assert "no monitor answers" in refused("status", "--connect", endpoint, names=endpoint)
    finally:
        session.close()
