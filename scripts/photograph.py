"""Opens a recording in the real viewer without a screen and saves a picture of it.

Usage: photograph.py VIEWER RECORDING PICTURE MAX_BYTES

The viewer's own `--screenshot-to` fires while a recording is still loading and under its own
messages; so the viewer is started without a screen, told to take a picture once both are over,
and stopped. PICTURE is a WebP file of the best quality that is small enough: features keep their
colours, which few colours would not.
"""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time

from PIL import Image
from rerun.experimental import ViewerClient

SIZE = (1600, 1000)
# The viewer's own bar, which shows where the picture was taken and not what it shows.
TOP_PX = 28
SETTLE_S = 25
TIMEOUT_S = 120


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def main(viewer, recording, picture, max_bytes):
    port = free_port()
    raw = os.path.join(tempfile.mkdtemp(), "raw.png")
    command = [viewer, recording, "--headless", "--bind", "127.0.0.1", "--port", str(port)]
    command += ["--window-size", f"{SIZE[0]}x{SIZE[1]}"]
    # A session of its own, because the command only starts the viewer and would leave it behind.
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        time.sleep(SETTLE_S)
        client = ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
        client.save_screenshot(raw)
        deadline = time.monotonic() + TIMEOUT_S
        while not (os.path.exists(raw) and os.path.getsize(raw) > 0):
            if process.poll() is not None or time.monotonic() > deadline:
                sys.exit(f"the viewer gave no picture of {recording}")
            time.sleep(0.2)
        time.sleep(1.0)
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(timeout=30)
    image = Image.open(raw).convert("RGB")
    # A viewer on a dense screen makes more pixels than were requested.
    image = image.resize(SIZE, Image.Resampling.LANCZOS).crop((0, TOP_PX, *SIZE))
    for quality in (92, 85, 75, 60):
        image.save(picture, "WEBP", quality=quality, method=6)
        if os.path.getsize(picture) < max_bytes:
            print(f"{picture}: {os.path.getsize(picture)} bytes")
            return
    sys.exit(f"{picture} has {os.path.getsize(picture)} bytes, more than {max_bytes}")


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4]))
