"""A service whose files lie in a bucket of S3 (`--blobs s3://…`), from outside.

    python bucket.py BINARY

Labels are those of the command line, results come whole and in ranges, deletion empties the bucket, a client that hangs
up leaves no part. Jobs name meshes that lie in the bucket. While the server of S3 cannot be reached or is full, answers
are 503, no job is lost, and none fails; once it is back, all end. Jobs of a service that is killed run again. A data
folder is not used with another bucket than its own.
"""

import concurrent.futures
import hashlib
import http.client
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import urllib.parse

from s3 import BUCKET, Bucket
from service import Service

BINARY = pathlib.Path(sys.argv[1]).resolve()
TEMPORARY = tempfile.TemporaryDirectory(prefix="tesserae-bucket-")
WORK = pathlib.Path(TEMPORARY.name)
CLUSTERS = 40


def run(*arguments):
    subprocess.run([BINARY, *map(str, arguments)], check=True, stdin=subprocess.DEVNULL)


def mesh(faces, bytes=0):
    """A mesh in a file of so many bytes at least."""
    path = WORK / f"{faces}.obj"
    run("sample", "knot", "--faces", faces, path)
    with open(path, "a") as file:
        file.write(("# " + 77 * "x" + "\n") * (max(0, bytes - path.stat().st_size) // 80 + 1))
    return path


def labels_of(path, *more):
    """SHA-256 of the labels that the command line gives."""
    out = WORK / "labels.bin"
    run("cluster", path, "--clusters", CLUSTERS, "--device", "cpu", "--labels", out, *more)
    return hashlib.sha256(out.read_bytes()).hexdigest()


def request(service, method, path, body=None, headers={}):
    """Status, headers and body of the answer."""
    connection = http.client.HTTPConnection(service.url.removeprefix("http://"), timeout=120)
    try:
        connection.request(method, path, body, headers)
        response = connection.getresponse()
        return response.status, response.headers, response.read()
    finally:
        connection.close()


def submit(service, path, query="", headers={}):
    return request(service, "POST", f"/v1/jobs?clusters={CLUSTERS}{query}", path.read_bytes(),
                   {"Content-Type": "model/obj", **headers})


def accepted(service, path, query=""):
    status, _, body = submit(service, path, query)
    assert status == 202, (status, body)
    return json.loads(body)["id"]


def job(service, id):
    status, _, body = request(service, "GET", f"/v1/jobs/{id}")
    assert status == 200, (status, body)
    return json.loads(body)


def until(what, condition, seconds=120):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.1)
    return found


def succeeded(service, id):
    def ended():
        found = job(service, id)
        return found if found["state"] not in ("queued", "running") else None
    found = until("the job ends", ended)
    assert found["state"] == "succeeded", found
    return found


def labels(service, id, **headers):
    return request(service, "GET", f"/v1/jobs/{id}/labels", headers={"Accept": "application/octet-stream", **headers})


def check_labels(service, id, expected):
    status, _, body = labels(service, id)
    assert status == 200 and hashlib.sha256(body).hexdigest() == expected, status


def serve(bucket, *arguments):
    return Service(BINARY, "--data-dir", WORK / "data", "--blobs", f"{bucket.url}/farm", "--device", "cpu",
                   "--mesh-prefixes", f"{bucket.url}/meshes/{{tenant}}", "--log", "warn", *arguments)


def is_ready(service):
    return request(service, "GET", "/readyz")[0] == 200


def ordinary_work(bucket, service, large, small):
    expected, of_small = labels_of(large), labels_of(small)
    first = accepted(service, large)
    succeeded(service, first)
    check_labels(service, first, expected)
    whole = labels(service, first)[2]
    for range, part in [("bytes=7-1000", whole[7:1001]), ("bytes=-5", whole[-5:]), ("bytes=200000-", whole[200000:])]:
        status, headers, body = labels(service, first, Range=range)
        assert status == 206 and body == part and headers["Content-Length"] == str(len(part)), (range, status)
    results = [key for key in bucket.keys("farm/") if f"results/{first}/1/" in key]
    assert results and not [key for key in bucket.keys("farm/uploads/")], "an ended job has results only"

    ids = [accepted(service, small) for _ in "123"]
    for id in ids:
        succeeded(service, id)
        check_labels(service, id, of_small)
    assert set(bucket.keys("farm/results/")) == set(results), "small ones are in the store"

    # a hierarchy, which is read from the bucket for each cut
    status, _, body = request(service, "POST", "/v1/jobs?algorithm=pml", mesh(5_000).read_bytes(),
                              {"Content-Type": "model/obj"})
    assert status == 202, (status, body)
    tree = json.loads(body)["id"]
    succeeded(service, tree)
    assert bucket.keys(f"farm/results/{tree}/"), "it is too small"
    for clusters in (CLUSTERS, 77):
        status, _, body = request(service, "GET", f"/v1/jobs/{tree}/labels?clusters={clusters}",
                                  headers={"Accept": "application/octet-stream"})
        assert status == 200, (status, body)
        assert len(set(memoryview(body).cast("I"))) == clusters

    for id in [first, tree, *ids]:
        assert request(service, "DELETE", f"/v1/jobs/{id}")[0] == 204
    assert not [key for key in bucket.keys("farm/") if not key.endswith("owner")], bucket.keys("farm/")


def a_client_that_hangs_up(bucket, service, large):
    connection = http.client.HTTPConnection(service.url.removeprefix("http://"), timeout=60)
    body = large.read_bytes()
    connection.putrequest("POST", "/v1/jobs?clusters=10")
    connection.putheader("Content-Type", "model/obj")
    connection.putheader("Content-Length", str(2 * len(body)))
    connection.endheaders(body)
    until("some of it is in the bucket", bucket.unfinished)
    connection.close()
    until("its parts are removed", lambda: not bucket.unfinished())
    assert not bucket.keys("farm/uploads/")


def by_reference(bucket, service, large):
    expected, body = labels_of(large), large.read_bytes()

    def job_of(query, body=None, headers={}):
        status, _, answer = request(service, "POST", f"/v1/jobs?clusters={CLUSTERS}&{query}", body, headers)
        return status, json.loads(answer)

    def refused(query, status, words, body=None):
        found, answer = job_of(query, body)
        assert (found, words in answer["detail"]) == (status, True), (query, found, answer)

    # an object of the bucket, with seeds in a form; one that is replaced while its job waits
    bucket.client.put_object(Bucket=BUCKET, Key="meshes/local/a b.obj", Body=body)
    of_url = f"mesh_url={urllib.parse.quote(bucket.url)}/meshes/local/a%20b.obj"
    refused(of_url, 400, "must be empty", b"v 0 0 0")
    refused(f"{of_url}&seeds=listed", 422, "seeds")
    status, found = job_of(of_url)
    assert status == 202, found
    assert found["mesh"]["file_name"] == "a b.obj", found
    succeeded(service, found["id"])
    check_labels(service, found["id"], expected)
    seeds = json.dumps(list(range(CLUSTERS)))
    form = f'--x\r\nContent-Disposition: form-data; name="seeds"; filename="s.json"\r\n\r\n{seeds}\r\n--x--\r\n'
    status, found = job_of(of_url, form.encode(), {"Content-Type": "multipart/form-data; boundary=x"})
    assert status == 202, found
    succeeded(service, found["id"])
    until("the seeds are removed", lambda: not bucket.keys("farm/uploads/"))
    assert bucket.keys("meshes/local/a b.obj"), "it is not the service's"
    busy = accepted(service, large, "&quality=best")
    waits = [job_of(f"{of_url}&quality=best&seed={seed}")[1]["id"] for seed in range(9)]
    bucket.client.put_object(Bucket=BUCKET, Key="meshes/local/a b.obj", Body=body + b"# other\n")
    request(service, "DELETE", f"/v1/jobs/{busy}")
    problem = until("it fails", lambda: job(service, waits[-1])["problem"])
    assert "replaced by another" in problem["detail"], problem
    for id in waits:
        request(service, "DELETE", f"/v1/jobs/{id}")
    for url, words in [(f"{bucket.url}/meshes/local/none.obj", "no object"), (f"{bucket.url}/farm/owner", "allows"),
                       (f"{bucket.url}/meshes/other/x.obj", "allows"), ("file:///etc/passwd", "allows"),
                       ("http://169.254.169.254/", "allows")]:
        refused(f"mesh_url={urllib.parse.quote(url)}", 422, words)

    # what the bucket does not show is named
    bucket.gate.denied = b"/meshes/local/"
    refused(of_url, 422, "s3:GetObject")
    assert is_ready(service)
    bucket.gate.denied = None


def no_bucket_for_a_while(bucket, service, large, small):
    expected, of_small = labels_of(large), labels_of(small)
    before = accepted(service, large)
    succeeded(service, before)
    # as many as keep the device busy until the bucket is away
    running = [accepted(service, large, "&quality=best") for _ in "123"]
    until("one runs", lambda: any(job(service, id)["state"] == "running" for id in running))
    bucket.gate.close()
    with concurrent.futures.ThreadPoolExecutor() as threads:
        refused = threads.submit(submit, service, large)
        unread = threads.submit(labels, service, before)
        for status, headers, body in (refused.result(), unread.result()):
            assert status == 503 and int(headers["Retry-After"]) > 0, (status, body)
            assert b"127.0.0.1" not in body and b"tesserae-test" not in body, "for the log only"
    until("the service is not ready", lambda: not is_ready(service))
    assert request(service, "GET", "/healthz")[0] == 200
    waits = accepted(service, small)
    deleted = accepted(service, small)
    assert request(service, "DELETE", f"/v1/jobs/{deleted}")[0] == 202
    assert request(service, "DELETE", f"/v1/jobs/{before}")[0] == 204, "its files go later"
    bucket.gate.open()
    until("the service is ready", lambda: is_ready(service), 60)
    for id in running:
        succeeded(service, id)
    succeeded(service, waits)
    check_labels(service, waits, of_small)
    again = accepted(service, large)
    succeeded(service, again)
    check_labels(service, again, expected)


def a_slow_and_a_full_bucket(bucket, service, large):
    expected = labels_of(large)
    # slow: the service answers others meanwhile
    bucket.gate.delay = 0.05
    with concurrent.futures.ThreadPoolExecutor() as threads:
        upload = threads.submit(accepted, service, large)
        slowest = 0
        while not upload.done():
            started = time.monotonic()
            assert request(service, "GET", "/healthz")[0] == 200
            slowest = max(slowest, time.monotonic() - started)
        id = upload.result()
    succeeded(service, id)
    assert slowest < 2, slowest
    check_labels(service, id, expected)
    bucket.gate.delay = 0

    # full: nothing new, everything else; what runs ends when there is room again
    running = [accepted(service, large, "&quality=best") for _ in "123"]
    bucket.gate.is_full = True
    status, headers, body = submit(service, large)
    assert status == 503 and int(headers["Retry-After"]) > 0, (status, body)
    until("the service is not ready", lambda: not is_ready(service))
    check_labels(service, id, expected)
    assert request(service, "DELETE", f"/v1/jobs/{id}")[0] == 204
    bucket.gate.is_full = False
    until("the service is ready", lambda: is_ready(service), 60)
    for id in running:
        succeeded(service, id)


def killed_with_work(bucket, large):
    expected = labels_of(large, "--quality", "best")
    service = serve(bucket)
    with service:
        ids = [accepted(service, large, "&quality=best") for _ in "123"]
        service.process.send_signal(signal.SIGKILL)
        service.process.wait()
        # the last one was accepted a moment before; others may have ended
        assert bucket.keys("farm/uploads/")
        # another process, which the end of the block stops
        service.__enter__()
        for id in ids:
            succeeded(service, id)
            check_labels(service, id, expected)
        # the end of a job is stored first
        until("uploads are removed", lambda: not bucket.keys("farm/uploads/"))


def refusals(bucket):
    def refused(*arguments, **environment):
        ended = subprocess.run([BINARY, "serve", "--listen", "127.0.0.1:0", "--device", "cpu", *map(str, arguments)],
                               env={**os.environ, **environment}, capture_output=True, text=True, timeout=120)
        assert ended.returncode != 0
        return ended.stderr
    data, here = WORK / "data", f"{bucket.url}/farm"
    assert "do not lie here: give --blobs" in refused("--data-dir", data)
    assert "do not lie here: give --blobs" in refused("--data-dir", data, "--blobs", f"{bucket.url}/other")
    assert "another store of jobs" in refused("--data-dir", WORK / "new", "--blobs", here)
    assert "cannot be stored at" in refused("--data-dir", WORK / "newer", "--blobs", "s3://no-such-bucket")
    assert "--data-dir" in refused("--blobs", here)
    assert "below the other" in refused("--data-dir", data, "--blobs", here, "--mesh-prefixes", bucket.url)
    assert "without encryption" in refused(
        "--data-dir", WORK / "newest", "--blobs", here, AWS_ENDPOINT_URL="http://s3.example:9000")


def main():
    # an upload in two parts, and a result that is too large for the store of jobs
    large, small = mesh(70_000, 9 << 20), mesh(2_000)
    with Bucket() as bucket:
        os.environ.update(bucket.environment)
        # a job of which one attempt counts has failed then
        with serve(bucket, "--max-attempts", "1") as service:
            ordinary_work(bucket, service, large, small)
            a_client_that_hangs_up(bucket, service, large)
            by_reference(bucket, service, large)
            no_bucket_for_a_while(bucket, service, large, small)
            a_slow_and_a_full_bucket(bucket, service, large)
        killed_with_work(bucket, large)
        refusals(bucket)
        assert not bucket.unfinished()
    print("bucket: all in order")


main()
