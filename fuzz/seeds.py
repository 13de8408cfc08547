"""Writes the seed corpus, `fuzz/seeds/TARGET/…`: a few small inputs for each target, from which fuzzers go on."""

import base64
import io
import json
import pathlib
import struct
import zipfile
import zlib

ROOT = pathlib.Path(__file__).parent / "seeds"

OBJ = b"""# two triangles, a quad and a polygon with slashes
mtllib a.mtl
o part
v 0 0 0
v 1 0 0 0.5 0.5 0.5
v 1.5e0 1 0
v -.25 +1. 1e-3
vt 0 0
vn 0 0 1
g left right
f 1 2 3
f 1/1 2/1 3/1 4/1
f -4//1 -3//1 -2//1
s off
usemtl red
f 1/1/1 2/1/1 \\
  4/1/1
"""

OFF = b"""COFF
4 2 5 # two faces
0 0 0 255 0 0 255
1 0 0 255 0 0 255
1 1.5e0 0 0 0 0 0
0 1e-3 +1 0 0 0 0

3 0 1 2
4 0 1 2 3 0.5 0.5 0.5
"""


def glb(document, binary):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf(uri=None):
    positions = struct.pack("<12f", 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1)
    indices = struct.pack("<6H", 0, 1, 2, 1, 3, 2)
    binary = positions + indices
    buffer = {"byteLength": len(binary)}
    if uri:
        buffer["uri"] = uri
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "children": [1]}, {"mesh": 0, "translation": [1, 2, 3], "scale": [1, -1, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "buffers": [buffer]}
    return document, binary


def ply(encoding):
    """A square of a triangle, a quad, a face of one corner and a strip, with an element that is skipped."""
    header = (f"ply\nformat {encoding} 1.0\ncomment x\nelement edge 1\nproperty list uchar short ends\n"
              "element vertex 4\nproperty float x\nproperty double y\nproperty char z\nproperty uchar red\n"
              "element face 3\nproperty list uchar int vertex_indices\nelement tristrips 1\n"
              "property list int int vertex_index\nend_header\n").encode()
    vertices = [(0, 0, 0, 9), (1, 0, 0, 9), (1, 1.5, 0, 9), (0, 1e-3, 1, 9)]
    lists = [[0, 1, 2], [0, 1, 2, 3], [2]]
    strip = [0, 1, 2, 3, -1, 1, 2, 3]
    if encoding == "ascii":
        rows = [(2, 0, 1), *vertices, *[(len(row), *row) for row in lists], (len(strip), *strip)]
        return header + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    order = "<" if "little" in encoding else ">"
    rows = [struct.pack(f"{order}B2h", 2, 0, 1)] + [struct.pack(f"{order}fdbB", *vertex) for vertex in vertices]
    rows += [struct.pack(f"{order}B{len(row)}i", len(row), *row) for row in lists]
    return header + b"".join(rows) + struct.pack(f"{order}i{len(strip)}i", len(strip), *strip)


def stl(name):
    """Two triangles as text and as bytes."""
    corners = [(0, 0, 0, 1, 0, 0, 1, 1.5, 0), (0, 0, 0, 1, 1.5, 0, 0, 1, -2e-3)]
    vertex = "      vertex {} {} {}\n"
    facet = "  facet normal 0 0 1\n    outer loop\n" + 3 * vertex + "    endloop\n  endfacet\n"
    text = f"solid {name}\n" + "".join(facet.format(*row) for row in corners) + f"endsolid {name}\n"
    rows = b"".join(struct.pack("<12fH", 0, 0, 1, *row, 0) for row in corners)
    return text.encode(), name.encode().ljust(80) + struct.pack("<I", len(corners)) + rows


def npy(descr, data, shape):
    header = repr({"descr": descr, "fortran_order": False, "shape": shape}).encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data


def npz(**arrays):
    """An archive, as `numpy.savez_compressed` writes it."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            archive.writestr(name + ".npy", array)
    return file.getvalue()


def png(colour, row):
    """Two equal rows of three pixels, 8 bits a sample."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    header = chunk(b"IHDR", struct.pack(">2I5B", 3, 2, 8, colour, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(2 * (b"\0" + row))) + chunk(b"IEND", b"")


def part(name, content, filename=None):
    name = f'name="{name}"' + (f'; filename="{filename}"' if filename else "")
    return b"--b\r\nContent-Disposition: form-data; " + name.encode() + b"\r\n\r\n" + content + b"\r\n"


def main():
    document, binary = gltf("a.bin")
    inside, _ = gltf("data:application/octet-stream;base64," + base64.b64encode(binary).decode())
    whole, _ = gltf()
    token = {"id": "0123456789abcdef", "salt": "AAAAAAAAAAAAAAAAAAAAAA", "sha256": "A" * 43}
    tokens = {"tenants": {"a": {"quotas": {"max_queued_jobs": 3}, "metrics": True, "tokens": [token]}}}
    trees = pathlib.Path(__file__).parent.glob("trees/*.tsr")
    x = npy("<f4", struct.pack("<12f", *range(12)), (4, 3))
    indptr, indices = (npy("<i4", struct.pack(f"<{len(row)}i", *row), (len(row),)) for row in [(0, 1, 3, 3, 4), (1, 0, 2, 3)])
    weights, mask = npy("<f8", struct.pack("<4d", 1, 2, 3, 4), (4,)), npy("|b1", bytes([1, 1, 0, 1]), (4,))
    matrix = {"format": npy("|S3", b"csr", ()), "shape": npy("<i8", struct.pack("<2q", 4, 4), (2,)),
              "data": npy("<f8", struct.pack("<4d", 1, 0, 1, 1), (4,)), "indptr": indptr, "indices": indices}
    seeds = {
        "obj": [OBJ, OBJ.replace(b"\n", b"\r\n"), b"v 0 0 0\nf 1 1 1\n", b""],
        "gltf": [
            json.dumps(document).encode() + b"\n===\n" + binary, json.dumps(inside).encode(), glb(whole, binary)],
        "ply": [ply("ascii"), ply("ascii").replace(b"\n", b"\r\n"), ply("binary_little_endian"), ply("binary_big_endian")],
        "stl": [*stl("a"), *stl("solid b"), stl("a")[0] + stl("b")[0].upper()],
        "off": [OFF, OFF.replace(b"\n", b"\r\n"), OFF.replace(b"COFF\n4 2 5", b"OFF4 2"), b"OFF BINARY\n"],
        "number": [b"1", b"-0.5e-10", b"+.1E+308", b"123456789012345678901234567890.5", b"1e-400", b"-2147483648"],
        "stored": [path.read_bytes() for path in trees],
        "points": [
            x, npy("|u1", bytes(range(24)), (2, 3, 4)), npz(X=x, weights=weights, mask=mask, indptr=indptr, indices=indices),
            npz(**matrix), b"\n===\n".join([x, indptr, indices, weights, mask]),
            b"\n===\n".join([x, indptr, indices, b"", b"", matrix["format"], matrix["shape"], matrix["data"]])],
        "image": [png(0, b"\0\x80\xff"), png(2, bytes(range(9))), png(6, bytes(range(12)))],
        "lists": [
            b"1 2 3\n4", b"[1, 2, 3]", npy("<u4", struct.pack("<3I", 1, 2, 3), (3,)),
            npy("<f8", struct.pack("<3d", 1, 2, 0.5), (3,)), npy("<i8", struct.pack("<2q", 1, 2), (2,))],
        "request": [
            b"clusters=3&seed=7&format=obj\n{\"refine\": \"none\"}",
            b"algorithm=pml&levels=20%2C10\n{\"webhook\": \"https://a.example/\", \"ties\": \"largest-id\"}"],
        "form": [
            part("mesh", OBJ, "a.obj") + part("parameters", b'{"clusters": 3}') + part("seeds", b"0 1 2") + b"--b--\r\n",
            part("mesh", json.dumps(document).encode(), "a.gltf") + part("buffer", binary, "a.bin") + b"--b--\r\n"],
        "tokens": [json.dumps(tokens).encode(), b"tess_0123456789abcdef_" + b"A" * 43],
        "headers": [
            b"00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01", b"bytes=0-9", b"W/\"abc-gzip\", \"x\"",
            b"application/x-npy;q=0.5, */*", b"respond-async, wait=10", b"https://hooks.example:8443/a?b"],
    }
    for target, inputs in seeds.items():
        folder = ROOT / target
        folder.mkdir(parents=True, exist_ok=True)
        for number, content in enumerate(inputs):
            (folder / str(number)).write_bytes(content)


if __name__ == "__main__":
    main()
