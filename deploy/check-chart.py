"""Checks the Helm chart: lint, and what it gives to Kubernetes.

    python check-chart.py FOLDER

With `helm` on the path, or the package helm-sdkpy, the chart is rendered by Helm itself for several values; by the
package, into an API server of this script that notes what it gets. Every object is checked against the schema of its
kind (kubernetes-validate), and those of other schemas, and what the objects say to each other, by hand. Without either
it says so, and only reads what is YAML without being rendered.
"""

import asyncio
import collections
import http.server
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading

import yaml

CHART = pathlib.Path(__file__).parent / "helm"
RELEASE = "farm"
# values beside the default ones
CASES = [
    {},
    {"scaling": {"enabled": False}, "monitoring": {"enabled": False}, "networkPolicy": {"enabled": False}},
    {"bucket": {"lifecycle": {"enabled": True}, "endpoint": "http://s3:9000", "allowHttp": True, "secret": ""},
     "serviceAccount": {"annotations": {"a": "b"}}, "monitoring": {"labels": {"release": "p"}},
     "image": {"tag": "1.2.3", "pullSecrets": [{"name": "registry"}]}, "workers": {"gpu": None}},
]
KINDS = {
    "v1": ["Secret", "Service", "ServiceAccount", "ConfigMap"],
    "apps/v1": ["Deployment"],
    "batch/v1": ["Job"],
    "policy/v1": ["PodDisruptionBudget"],
    "networking.k8s.io/v1": ["NetworkPolicy"],
    "keda.sh/v1alpha1": ["ScaledObject", "TriggerAuthentication"],
    "monitoring.coreos.com/v1": ["ServiceMonitor", "PrometheusRule"],
}
# kinds of operators, whose schemas are theirs
OF_OPERATORS = {"ScaledObject", "TriggerAuthentication", "ServiceMonitor", "PrometheusRule"}


def plural(kind):
    return kind.lower() + "s" if not kind.endswith("y") else kind.lower()[:-1] + "ies"


class Server(http.server.BaseHTTPRequestHandler):
    """As much of the API of Kubernetes as an installation needs. Objects that are made are noted."""

    protocol_version = "HTTP/1.1"
    noted = []

    def answer(self, status, found, media_type="application/json"):
        body = found if isinstance(found, bytes) else json.dumps(found).encode()
        self.send_response(status)
        self.send_header("Content-Type", media_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def do_GET(self):
        path = self.path.split("?")[0].strip("/")
        groups = [group for group in KINDS if "/" in group]
        if path == "version":
            return self.answer(200, {"major": "1", "minor": "33", "gitVersion": "v1.33.0"})
        if path == "api":
            return self.answer(200, {"kind": "APIVersions", "versions": ["v1"]})
        if path == "apis":
            versions = [{"groupVersion": group, "version": group.split("/")[1]} for group in groups]
            return self.answer(200, {"kind": "APIGroupList", "apiVersion": "v1", "groups": [
                {"name": each["groupVersion"].split("/")[0], "versions": [each], "preferredVersion": each}
                for each in versions]})
        group = re.sub("^apis?/", "", path)
        if group in KINDS:
            return self.answer(200, {"kind": "APIResourceList", "groupVersion": group, "resources": [
                {"name": plural(kind), "singularName": "", "namespaced": True, "kind": kind,
                 "verbs": ["create", "delete", "get", "list", "patch", "update"]} for kind in KINDS[group]]})
        if path.split("/")[-1] in {plural(kind) for kinds in KINDS.values() for kind in kinds}:
            return self.answer(200, {"kind": "List", "apiVersion": "v1", "metadata": {}, "items": []})
        self.answer(404, {"kind": "Status", "apiVersion": "v1", "status": "Failure", "reason": "NotFound", "code": 404})

    def do_DELETE(self):
        self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self.do_GET()

    def do_POST(self):
        media_type, made = self.headers["Content-Type"], self.rfile.read(int(self.headers["Content-Length"]))
        # Helm's note of the release, a secret, is no JSON
        if media_type == "application/json":
            self.noted.append(json.loads(made))
        self.answer(201, made, media_type)

    def do_PUT(self):
        self.answer(200, self.rfile.read(int(self.headers["Content-Length"])), self.headers["Content-Type"])

    do_PATCH = do_PUT

    def log_message(self, *_):
        pass


def by_package(values):
    """The objects of an installation, by helm-sdkpy."""
    import helm_sdkpy
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Server)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    Server.noted.clear()
    with tempfile.TemporaryDirectory() as folder, tempfile.NamedTemporaryFile("w", suffix=".yaml") as config:
        # Helm checks what is made by hooks itself, by schemas that the server does not have
        chart = shutil.copytree(CHART, pathlib.Path(folder) / "chart")
        for template in chart.glob("templates/*.yaml"):
            template.write_text(re.sub(" *helm.sh/hook.*\n", "", template.read_text()))
        yaml.safe_dump({
            "apiVersion": "v1", "kind": "Config", "current-context": "c",
            "clusters": [{"name": "c", "cluster": {"server": "http://127.0.0.1:%d" % server.server_port}}],
            "contexts": [{"name": "c", "context": {"cluster": "c", "user": "u"}}],
            "users": [{"name": "u", "user": {}}]}, config)
        config.flush()

        async def install():
            configuration = helm_sdkpy.Configuration(namespace="default", kubeconfig=config.name)
            result = await helm_sdkpy.Lint(configuration).run(str(CHART))
            errors = [each for each in result.get("Messages") or [] if each.get("Severity", 0) > 1]
            assert not errors and not result.get("Errors"), result
            await helm_sdkpy.Install(configuration).run(RELEASE, str(chart), values, wait=False, timeout=20)
        asyncio.run(install())
    server.shutdown()
    return list(Server.noted)


def by_program(values):
    """The objects that `helm template` writes."""
    subprocess.run(["helm", "lint", "--strict", CHART], check=True)
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        yaml.safe_dump(values, file)
        file.flush()
        text = subprocess.run(["helm", "template", RELEASE, CHART, "--values", file.name, "--kube-version", "1.33.0"],
                              check=True, capture_output=True, text=True).stdout
    return [each for each in yaml.safe_load_all(text) if each]


def check(objects, values):
    by_kind = collections.defaultdict(list)
    for each in objects:
        by_kind[each["kind"]].append(each)
        if each["kind"] not in OF_OPERATORS:
            import kubernetes_validate
            kubernetes_validate.validate(each, "1.33", strict=True)
    names = collections.Counter((each["kind"], each["metadata"]["name"]) for each in objects)
    assert max(names.values()) == 1, names
    pods = {}
    for each in by_kind["Deployment"]:
        pod = each["spec"]["template"]
        labels = pod["metadata"]["labels"]
        pods[each["metadata"]["name"]] = labels
        assert each["spec"]["selector"]["matchLabels"].items() <= labels.items()
        container, = pod["spec"]["containers"]
        environment = {variable["name"]: variable.get("value") for variable in container["env"]}
        assert len(environment) == len(container["env"]), "a variable twice"
        assert {name for name in environment if not name.startswith("AWS_")} <= KNOWN, "no such setting"
        is_front = each["metadata"]["name"].endswith("-front")
        assert environment["TESSERAE_WORK"] == ("off" if is_front else "on")
        stop = int(environment["TESSERAE_DRAIN_DELAY"]) + int(environment["TESSERAE_GRACE_PERIOD"]) + 10
        assert pod["spec"]["terminationGracePeriodSeconds"] >= stop, "it is killed before it has stopped"
        assert environment.get("AWS_ENDPOINT_URL") == (values.get("bucket", {}).get("endpoint"))
        assert all(container[probe] for probe in ("startupProbe", "livenessProbe", "readinessProbe"))
        assert container["securityContext"]["readOnlyRootFilesystem"] and pod["spec"]["securityContext"]["runAsNonRoot"]
        volumes = {volume["name"]: volume for volume in pod["spec"]["volumes"]}
        mounts = {mount["name"]: mount for mount in container["volumeMounts"]}
        assert mounts.keys() == volumes.keys()
        # every service reads the one secret; a file that is mounted by a subPath would not change with it
        assert volumes["tokens"]["secret"]["secretName"] and "subPath" not in mounts["tokens"]
        assert environment["TESSERAE_TOKENS"].rpartition("/")[0] == mounts["tokens"]["mountPath"]

    def chosen(selector):
        return {name for name, labels in pods.items() if selector.items() <= labels.items()}
    fronts = {f"{RELEASE}-front"}
    services = {each["metadata"]["name"]: chosen(each["spec"]["selector"]) for each in by_kind["Service"]}
    assert services[RELEASE] == fronts, services
    for each in by_kind["PodDisruptionBudget"]:
        assert chosen(each["spec"]["selector"]["matchLabels"]) == {each["metadata"]["name"]}
    groups = set(pods) - fronts
    assert len(groups) == (1 if "workers" in values else 2), groups
    if values.get("scaling", {}).get("enabled", True):
        scaled = {each["spec"]["scaleTargetRef"]["name"]: each["spec"] for each in by_kind["ScaledObject"]}
        assert set(scaled) == groups
        authentication, = by_kind["TriggerAuthentication"]
        for spec in scaled.values():
            trigger, = spec["triggers"]
            assert trigger["type"] == "postgresql" and "tesserae.jobs" in trigger["metadata"]["query"]
            assert trigger["authenticationRef"]["name"] == authentication["metadata"]["name"]
            assert 0 <= spec["minReplicaCount"] < spec["maxReplicaCount"]
    else:
        assert not by_kind["ScaledObject"]
        assert all(each["spec"]["replicas"] >= 1 for each in by_kind["Deployment"])
    if values.get("monitoring", {}).get("enabled", True):
        assert services[f"{RELEASE}-metrics"] == set(pods)
        monitor, = by_kind["ServiceMonitor"]
        service, = [each for each in by_kind["Service"] if each["metadata"]["name"].endswith("-metrics")]
        assert monitor["spec"]["selector"]["matchLabels"].items() <= service["metadata"]["labels"].items()
        rules, = by_kind["PrometheusRule"]
        alerts = [rule["alert"] for group in rules["spec"]["groups"] for rule in group["rules"]]
        in_files = re.findall("- alert: (.*)", "".join((CHART.parent / name).read_text() for name in RULES))
        assert alerts == in_files and len(alerts) > 15, "the rules are those of the files"
    if values.get("networkPolicy", {}).get("enabled", True):
        assert len(by_kind["NetworkPolicy"]) == 2
    if values.get("bucket", {}).get("lifecycle"):
        job, = by_kind["Job"]
        given = " ".join(job["spec"]["template"]["spec"]["containers"][0]["args"])
        assert "--bucket=tesserae " in given and "AbortIncompleteMultipartUpload" in given
    return len(objects)


RULES = ["alerts.yaml", "farm-alerts.yaml"]
# the first two are of services that share a store
KNOWN = {"TESSERAE_STORE", "TESSERAE_WORK"} | set(
    re.findall("`(TESSERAE_[A-Z_]*)`", (CHART.parent.parent / "docs/operations.md").read_text()))


def main():
    for each in ["Chart.yaml", "values.yaml", "files/lifecycle.json"]:
        assert yaml.safe_load((CHART / each).read_text()), each
    render = by_program if shutil.which("helm") else by_package
    try:
        if render is by_package:
            import helm_sdkpy  # noqa: F401
    except (ImportError, OSError):
        print("helm is not there, nor helm-sdkpy (Python 3.12 and later): the chart is not rendered", file=sys.stderr)
        return
    for values in CASES:
        objects = render(values)
        print(f"chart: {check(objects, values)} objects with {json.dumps(values)[:60]}")


main()
