"""How schemathesis writes bodies of the media types of meshes: as they are, so that the example of the document makes a job.

With LINKS_ONLY in the environment, every POST of a job is accepted: links to a job are only followed where there is one.
"""

import os

import schemathesis

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@schemathesis.serializer("model/obj", "model/gltf-binary", "model/gltf+json")
def mesh(_, value):
    return value.encode() if isinstance(value, str) else bytes(value)


if "LINKS_ONLY" in os.environ:

    @schemathesis.hook
    def map_case(_, case):
        if (case.method, case.path) == ("POST", "/v1/jobs"):
            case.body, case.media_type, case.query = TETRAHEDRON, "model/obj", {"clusters": 1}
        return case
