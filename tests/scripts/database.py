"""A PostgreSQL server of a test: from Debian's package, on a free loopback port, in a temporary folder."""

import glob
import os
import pathlib
import shutil
import socket
import subprocess
import tempfile


def programs():
    """The folder of the server's programs, of the newest version that is installed."""
    found = glob.glob("/usr/lib/postgresql/*/bin")
    found.sort(key=lambda folder: int(folder.split("/")[-2]))
    path = shutil.which("initdb")
    assert found or path, "PostgreSQL is not installed: deploy/install-missing.sh test installs it"
    return pathlib.Path(found[-1] if found else os.path.dirname(path))


class Database:
    """A server for as long as a `with` block lasts; it refuses to run as root, so root's tests run it as nobody."""

    def __enter__(self):
        self.programs = programs()
        self.folder = tempfile.TemporaryDirectory(prefix="tesserae-postgres-")
        self.data = os.path.join(self.folder.name, "data")
        self.user = {}
        if os.getuid() == 0:
            os.chown(self.folder.name, 65534, 65534)
            self.user = {"user": 65534, "group": 65534, "extra_groups": []}
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.run("initdb", "--no-sync", "--auth=trust", "--encoding=UTF8", "--username=tesserae", "-D", self.data)
        self.start()
        self.run("createdb", "-h", "127.0.0.1", "-p", str(self.port), "-U", "tesserae", "farm")
        self.url = f"postgres://tesserae:not-a-secret@127.0.0.1:{self.port}/farm"
        return self

    def run(self, program, *arguments):
        done = subprocess.run([self.programs / program, *arguments], cwd=self.folder.name, stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **self.user)
        assert done.returncode == 0, f"{program} ended with {done.returncode}:\n{done.stdout.decode()}"
        return done.stdout.decode()

    def start(self):
        options = (f"-c listen_addresses=127.0.0.1 -c port={self.port} -c unix_socket_directories= "
                   "-c max_connections=200")
        # its output must not be the pipe of the call, which would wait for the server's end
        subprocess.run([self.programs / "pg_ctl", "-w", "-s", "-D", self.data, "-l", self.data + ".log", "-o", options,
                        "start"], cwd=self.folder.name, check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                       stderr=subprocess.DEVNULL, **self.user)

    def kill(self):
        """Stops it as a crash does: the next start recovers what was committed."""
        self.run("pg_ctl", "-w", "-s", "-D", self.data, "-m", "immediate", "stop")

    def ask(self, sql):
        """What a query gives, as text."""
        place = ["-h", "127.0.0.1", "-p", str(self.port), "-U", "tesserae", "-d", "farm"]
        return self.run("psql", *place, "-Atc", sql).strip()

    def __exit__(self, *_):
        if os.path.exists(os.path.join(self.data, "postmaster.pid")):
            self.kill()
        self.folder.cleanup()
