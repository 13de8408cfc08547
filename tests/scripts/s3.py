"""A server that speaks the protocol of S3 (moto, in memory), on a free loopback port, for as long as something runs.

    python s3.py COMMAND…

runs the command with a bucket of such a server: its URL is in TESSERAE_TEST_S3, and how to reach it in AWS_*.
"""

import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request

import boto3

BUCKET = "tesserae-test"
KEYS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1"}


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Bucket:
    """A bucket of a server of its own, which lasts as long as a `with` block. `client` reads it without the gate."""

    def __enter__(self):
        port = free_port()
        self.log = tempfile.TemporaryFile()
        # a library of the server would look for keys on the network
        environment = {**os.environ, **KEYS, "AWS_EC2_METADATA_DISABLED": "true"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
            stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log, env=environment)
        direct = f"http://127.0.0.1:{port}"
        self.client = boto3.client(
            "s3", endpoint_url=direct, region_name=KEYS["AWS_REGION"],
            aws_access_key_id="test", aws_secret_access_key="test")
        try:
            self.wait_until_it_answers(direct)
            self.client.create_bucket(Bucket=BUCKET)
        except BaseException:
            self.__exit__()
            raise
        self.gate = Gate(port)
        self.environment = {**KEYS, "AWS_ENDPOINT_URL": self.gate.url}
        self.url = f"s3://{BUCKET}"
        return self

    def wait_until_it_answers(self, url):
        deadline = time.monotonic() + 120
        while True:
            try:
                return urllib.request.urlopen(url, timeout=5).close()
            except OSError:
                if self.process.poll() is not None or time.monotonic() > deadline:
                    self.log.seek(0)
                    raise RuntimeError(f"moto did not start:\n{self.log.read().decode()}") from None
                time.sleep(0.1)

    def keys(self, below=""):
        """Names and sizes of all objects."""
        pages = self.client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=below)
        return {found["Key"]: found["Size"] for page in pages for found in page.get("Contents", [])}

    def unfinished(self):
        """Names of objects whose parts are there, and which are not."""
        return [found["Key"] for found in self.client.list_multipart_uploads(Bucket=BUCKET).get("Uploads", [])]

    def __exit__(self, *_):
        if hasattr(self, "gate"):
            self.gate.close()
        self.process.terminate()
        self.process.wait(timeout=30)


class Gate:
    """What stands between the service and the server: open, or closed as if no server were there.

    The server keeps its objects in memory, so it is not the one to be stopped.
    """

    def __init__(self, port):
        self.behind = ("127.0.0.1", port)
        self.address = ("127.0.0.1", free_port())
        self.url = "http://%s:%d" % self.address
        self.sockets = set()
        self.open()

    def open(self):
        self.listener = socket.create_server(self.address, backlog=128)
        threading.Thread(target=self.accept, args=[self.listener], daemon=True).start()

    def close(self):
        """No connection is taken from now on, and those that are there break."""
        # a thread that waits in accept would keep the listener
        self.listener.shutdown(socket.SHUT_RDWR)
        self.listener.close()
        for each in list(self.sockets):
            try:
                each.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def accept(self, listener):
        while True:
            try:
                near = listener.accept()[0]
            except OSError:
                return
            try:
                far = socket.create_connection(self.behind)
            except OSError:
                near.close()
                continue
            self.sockets |= {near, far}
            for source, target in [(near, far), (far, near)]:
                threading.Thread(target=self.copy, args=[source, target], daemon=True).start()

    def copy(self, source, target):
        try:
            while chunk := source.recv(1 << 16):
                target.sendall(chunk)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            for each in (source, target):
                try:
                    each.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
        self.sockets.discard(source)


if __name__ == "__main__":
    with Bucket() as bucket:
        environment = {**os.environ, **bucket.environment, "TESSERAE_TEST_S3": bucket.url}
        sys.exit(subprocess.run(sys.argv[1:], env=environment).returncode)
