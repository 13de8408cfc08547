"""A server that speaks the protocol of S3 (moto, in memory), on a free loopback port, for as long as something runs.

    python s3.py COMMAND…

runs the command with a bucket of such a server: its URL is in TESSERAE_TEST_S3, and how to reach it in AWS_*.
"""

import os
import subprocess
import sys
import tempfile
import time
import urllib.request

import boto3

from gate import Gate, free_port

BUCKET = "tesserae-test"
KEYS = {"AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test", "AWS_REGION": "us-east-1"}


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
                return urllib.request.urlopen(url, timeout=60).close()
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
        self.process.wait(timeout=120)


if __name__ == "__main__":
    with Bucket() as bucket:
        environment = {**os.environ, **bucket.environment, "TESSERAE_TEST_S3": bucket.url}
        sys.exit(subprocess.run(sys.argv[1:], env=environment).returncode)
