"""How schemathesis writes bodies of the media types of meshes: as they are, so that the example of the document makes a job."""

import schemathesis


@schemathesis.serializer("model/obj", "model/gltf-binary", "model/gltf+json")
def mesh(_, value):
    return value.encode() if isinstance(value, str) else bytes(value)
