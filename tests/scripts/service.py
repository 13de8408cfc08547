"""Starts the service on a free loopback port for as long as a `with` block lasts."""

import pathlib
import re
import signal
import socket
import subprocess
import tempfile
import time
import urllib.request


def resident(process):
    """Memory of a process that is in use, in MB."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", status)[1]) / 1024


class Service:
    """`tesserae serve` in a process of its own; `url` is where it listens."""

    def __init__(self, binary, *arguments):
        self.command = [str(binary), "serve", *arguments]

    def __enter__(self):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.address = f"127.0.0.1:{probe.getsockname()[1]}"
        self.url = f"http://{self.address}"
        self.log = tempfile.TemporaryFile()
        self.start()
        return self

    def start(self):
        """Starts the process, at the same address each time."""
        self.process = subprocess.Popen(
            [*self.command, "--listen", self.address], stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log)
        try:
            self.wait_until_ready()
        except BaseException:
            self.stop()
            raise

    def kill(self):
        """Ends the process as a crash does."""
        self.process.kill()
        self.process.wait()

    def wait_until_ready(self):
        deadline = time.monotonic() + 120
        while True:
            try:
                urllib.request.urlopen(self.url + "/readyz", timeout=60).close()
                return
            except OSError:
                if self.process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"the service did not start:\n{self.logged()}") from None
                time.sleep(0.05)

    def logged(self):
        """What it wrote so far."""
        self.log.seek(0)
        return self.log.read().decode(errors="replace")

    def stop(self):
        """Asks it to stop, and returns its exit status."""
        self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(timeout=120)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise RuntimeError(f"the service did not stop within two minutes:\n{self.logged()}") from None

    def __exit__(self, kind, *_):
        status = self.process.poll() if self.process.poll() is not None else self.stop()
        if kind is not None:
            print(self.logged()[-4000:])
        elif status != 0:
            raise RuntimeError(f"the service ended with status {status}:\n{self.logged()}")
