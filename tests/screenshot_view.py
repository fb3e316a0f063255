"""Make a screenshot of what ``loopsight view`` shows: the picture in the README.

Run: ``python -m tests.screenshot_view docs/view.png [--connect ENDPOINT | --url URL] [--wait 8]``.
Without ``--connect`` and ``--url`` a fake monitor is shown. It draws with Rerun's native viewer, without a
window; where there is no graphics card that needs a software Vulkan driver (Debian: ``mesa-vulkan-drivers``
and ``libvulkan1``).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from monitor.adapters.rerun_view import process
from monitor.view.process import start_view
from tests.support.fake_monitor import FakeMonitor, demo_loops

BAR = 36
"""Height of the viewer's own bar at the top."""
SOFTWARE_VULKAN = Path("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json")


def missing() -> str:
    """Why no screenshot can be made here, or nothing."""
    try:
        process.program()
    except process.RerunError as error:
        return str(error)
    if sys.platform.startswith("linux") and not (SOFTWARE_VULKAN.exists() or process.has_display()):
        return "no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1"
    return ""


@contextmanager
def headless(url: str, size: str) -> Iterator[Callable[[Path], None]]:
    """Rerun's native viewer without a window, showing what a browser would at ``url``; gives what saves a PNG."""
    from rerun.experimental import ViewerClient  # noqa: PLC0415

    proxy = parse_qs(urlsplit(url).query)["url"][0] if url.startswith("http") else url
    port = process.free_ports(1)[0]
    env = {**os.environ, "RUST_LOG": "off", "XDG_RUNTIME_DIR": tempfile.gettempdir()}
    if SOFTWARE_VULKAN.exists():
        env["VK_DRIVER_FILES"] = str(SOFTWARE_VULKAN)
    command = [str(process.program()), "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--window-size", size, "--hide-welcome-screen", "--renderer", "vulkan", proxy]
    viewer = subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline, client = time.monotonic() + 30, None
        while client is None:
            try:
                client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            except (RuntimeError, ConnectionError, ValueError):
                if time.monotonic() > deadline or viewer.poll() is not None:
                    raise
                time.sleep(0.2)
        yield lambda target: client.save_screenshot(str(target.resolve()))
    finally:
        viewer.terminate()
        viewer.wait(10)


def crop(target: Path, size: str) -> None:
    """Cut the window's bar off."""
    from PIL import Image  # noqa: PLC0415 - comes with rerun

    width = int(size.split("x", 1)[0])
    with Image.open(target) as picture:
        rest = picture.crop((0, BAR * picture.width // width, picture.width, picture.height))
        rest.convert("RGB").save(target, optimize=True)


def main() -> None:
    """Parse the options, start what is needed, shoot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("target", type=Path)
    parser.add_argument("--connect", metavar="ENDPOINT", help="show this monitor")
    parser.add_argument("--url", help="show what a running view does: the address that it printed")
    parser.add_argument("--size", default="1600x1000")
    parser.add_argument("--wait", type=float, default=8.0)
    args = parser.parse_args()
    if why := missing():
        sys.exit(why)
    if args.url:
        shoot(args.url, args)
        return
    fake = None if args.connect else FakeMonitor(process.free_ports(1)[0], demo_loops())
    view = start_view(args.connect or (fake.endpoint if fake else ""), "web")
    try:
        if not view.url:
            sys.exit("the view did not start")
        if fake:
            fake.health()
            for loop in fake.loops:
                fake.tell(loop)
            time.sleep(2.0)  # the view asks for the trends of what it has been told
            for loop in fake.loops:
                fake.go_on(loop, 3600, 400)
        shoot(view.url, args)
    finally:
        view.stop()
        if fake:
            fake.close()


def shoot(url: str, args: argparse.Namespace) -> None:
    """Draw for ``args.wait`` seconds, then save."""
    with headless(url, args.size) as save:
        time.sleep(args.wait)
        save(args.target)
    crop(args.target, args.size)


if __name__ == "__main__":
    main()
