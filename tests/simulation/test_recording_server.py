"""While a run is recorded, no program can connect to it."""

import os
import socket
import stat

from drake_pregrasp.simulation.recording import start_meshcat


def open_addresses():
    """Returns the addresses of the sockets of this process."""
    found = set()
    for number in os.listdir("/proc/self/fd"):
        path = f"/proc/self/fd/{number}"
        if os.path.exists(path) and stat.S_ISSOCK(os.stat(path).st_mode):
            with socket.socket(fileno=os.dup(int(number))) as opened:
                found.add(opened.getsockname())
    return found


def test_nothing_listens_while_a_run_is_recorded():
    before = open_addresses()
    meshcat = start_meshcat()
    assert open_addresses() == before
    meshcat.SetProperty("/drake", "visible", False)
    assert "MeshCat" in meshcat.StaticHtml()
    first, second = (start_meshcat(live=True) for _ in range(2))  # These do listen.
    assert len(open_addresses() - before) == 2
    assert first.web_url().rpartition(":")[0] != second.web_url().rpartition(":")[0]
