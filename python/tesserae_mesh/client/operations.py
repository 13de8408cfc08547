"""The operations of the service, as a table: method, path, and the names of parameters.

A request is built from its row, which refuses a name that the row does not have. A test compares the rows with
``openapi.yaml``; another one sees that the methods of `Client` and `Job` use every row and every name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Mapping
from urllib.parse import quote

from tesserae_mesh.client.exchange import Request

PARAMETERS = (
    "algorithm energy shapes resolution tolerance clusters quality seeds seed max_iterations refine allow_disconnected "
    "bridge_components features snapshots subdivide curvature_exponent weight_attribute graph compactness optimize optimize_iterations "
    "switch_to_ml_at collapse_fraction ties pairs levels priority outputs keep_mesh webhook"
).split()
"""Members of the part ``parameters`` of an upload."""

PARTS = ["mesh", "points", "parameters", "buffer", "seeds", "graph", "weights"]
"""Parts of the form of an upload."""


@dataclass(frozen=True)
class Operation:
    """A row of the table."""

    id: str
    method: str
    path: str
    query: tuple[str, ...] = ()
    headers: tuple[str, ...] = ()

    def request(
        self,
        id: str = "",
        query: Mapping[str, str | float | None] | None = None,
        headers: Mapping[str, str | float | None] | None = None,
        accept: str = "application/json",
    ) -> Request:
        """A request with the parameters that are not None.

        Parameters
        ----------
        id : str
            The job or the upload.
        query, headers : mapping
            Values by name.
        accept : str
            Media type of the answer, where ``format`` does not choose one.
        """
        unknown = [*(set(query or {}) - set(self.query)), *(set(headers or {}) - set(self.headers))]
        if unknown:
            raise TypeError(f"{self.id} has no parameter of that name: {unknown[0]}")
        return Request(
            self.method,
            self.path.replace("{id}", quote(id, safe="")),
            {name: _text(value) for name, value in (query or {}).items() if value is not None},
            {
                "accept": f"{accept}, application/problem+json",
                **{name: _text(value) for name, value in (headers or {}).items() if value is not None},
            },
        )


def _text(value: str | float) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return str(value)


def _of_job(id: str, name: str, *query: str) -> Operation:
    return Operation(id, "GET", f"/v1/jobs/{{id}}/{name}", query)


_ALL = [
    Operation("createJob", "POST", "/v1/jobs", ("format", "mesh_url"), ("Prefer", "Idempotency-Key")),
    Operation("listJobs", "GET", "/v1/jobs", ("state", "cursor", "limit")),
    Operation("getJob", "GET", "/v1/jobs/{id}"),
    Operation("deleteJob", "DELETE", "/v1/jobs/{id}", ("cancel",)),
    Operation("retryJob", "POST", "/v1/jobs/{id}/retry"),
    _of_job("getUpload", "upload", "buffer"),
    Operation("streamEvents", "GET", "/v1/jobs/{id}/events", ("labels",), ("Last-Event-ID",)),
    _of_job("getLabels", "labels", "clusters", "iteration", "format"),
    _of_job("getHierarchy", "hierarchy", "min_clusters", "max_clusters", "clusters", "format"),
    _of_job("getReport", "report"),
    _of_job("getMesh", "mesh", "format", "clusters", "ply_vertex_colours", "colours"),
    _of_job("getSubmeshes", "submeshes", "format", "clusters", "force"),
    _of_job("getGraph", "graph", "format", "clusters"),
    _of_job("getBoundaries", "boundaries", "format", "clusters"),
    _of_job("getClusters", "clusters", "format", "clusters"),
    _of_job("getMeans", "means", "format", "clusters"),
    _of_job("getRemesh", "remesh", "format", "clusters", "placement"),
    _of_job("getRemeshSource", "remesh-source", "format", "clusters", "placement"),
    Operation("listWorkers", "GET", "/v1/workers"),
    Operation("getDevice", "GET", "/v1/device"),
    Operation("getFormats", "GET", "/v1/formats"),
    Operation("getLimits", "GET", "/v1/limits"),
    Operation("getVersion", "GET", "/v1/version"),
    Operation("getHealth", "GET", "/healthz"),
    Operation("getReadiness", "GET", "/readyz"),
    Operation("getMetrics", "GET", "/metrics"),
    Operation("getOpenapi", "GET", "/openapi.yaml"),
]

OPERATIONS: Mapping[str, Operation] = {operation.id: operation for operation in _ALL}
"""The rows by ``operationId``."""
