"""Scores face labels with numpy alone, from the definitions and not from the program that made them.

    python score.py MESH LABELS.npy          prints JSON

MESH is an OBJ (polygons are faces), or a GLB of plain triangles in float positions (scene graph included).
"""

import json
import struct
import sys

import numpy as np


def load_obj(path):
    """Vertices (n, 3), faces as a flat list of corners and the first corner of each face."""
    vertices, corners, first = [], [], [0]
    with open(path, encoding="utf-8", errors="replace") as lines:
        for line in lines:
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                vertices.append([float(x) for x in words[1:4]])
            elif words[0] == "f":
                for word in words[1:]:
                    index = int(word.split("/")[0])
                    corners.append(index - 1 if index > 0 else len(vertices) + index)
                first.append(len(corners))
    return np.array(vertices), np.array(corners), np.array(first)


def load_glb(path):
    """The triangles of the default scene, in the order of its nodes."""
    data = open(path, "rb").read()
    magic, _, _, json_length, _ = struct.unpack_from("<4sIIII", data)
    assert magic == b"glTF", "not a GLB file"
    document = json.loads(data[20 : 20 + json_length])
    binary = data[20 + json_length + 8 :]

    def accessor(number):
        info = document["accessors"][number]
        view = document["bufferViews"][info["bufferView"]]
        dtype = np.dtype({5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[info["componentType"]])
        width = {"SCALAR": 1, "VEC3": 3}[info["type"]]
        return np.ndarray(
            (info["count"], width), dtype, binary, view.get("byteOffset", 0) + info.get("byteOffset", 0),
            (view.get("byteStride", width * dtype.itemsize), dtype.itemsize))

    vertices, corners, count = [], [], 0

    def visit(number, parent):
        nonlocal count
        node = document["nodes"][number]
        matrix = parent @ local_matrix(node)
        if "mesh" in node:
            for primitive in document["meshes"][node["mesh"]]["primitives"]:
                assert primitive.get("mode", 4) == 4, "not triangles"
                points = accessor(primitive["attributes"]["POSITION"]).astype(np.float64)
                vertices.append(points @ matrix[:3, :3].T + matrix[:3, 3])
                indices = (accessor(primitive["indices"]).astype(np.int64).ravel()
                           if "indices" in primitive else np.arange(len(points)))
                corners.append(indices + count)
                count += len(points)
        for child in node.get("children", []):
            visit(child, matrix)

    for root in document["scenes"][document.get("scene", 0)]["nodes"]:
        visit(root, np.eye(4))
    corners = np.concatenate(corners)
    return np.concatenate(vertices), corners, np.arange(0, len(corners) + 1, 3)


def local_matrix(node):
    """The transform of a node."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]) * np.array(node.get("scale", [1, 1, 1]), float)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def load(path):
    return (load_obj if str(path).endswith(".obj") else load_glb)(path)


def fans(corners, first):
    """Triangles (m, 3) of the fans from each face's first corner, and the face of each."""
    sizes = np.diff(first)
    triangles_of = np.maximum(sizes - 2, 0)
    face = np.repeat(np.arange(len(sizes)), triangles_of)
    nth = np.arange(len(face)) - np.repeat(np.cumsum(triangles_of) - triangles_of, triangles_of)
    start = first[:-1][face]
    return np.stack([corners[start], corners[start + nth + 1], corners[start + nth + 2]], 1), face


def disconnected(vertices, corners, first, labels, area):
    """Number of clusters that are in several pieces across shared edges, equal positions being one vertex.

    Pieces without area are not counted: such faces may belong to a cluster that they do not touch.
    """
    _, weld = np.unique(vertices + 0.0, axis=0, return_inverse=True)
    corner = weld.ravel()[corners]
    face = np.repeat(np.arange(len(first) - 1), np.diff(first))
    after = np.arange(1, len(corners) + 1)
    after[first[1:] - 1] = first[:-1]
    ends = np.sort(np.stack([corner, corner[after]], 1), axis=1)
    real = ends[:, 0] != ends[:, 1]
    # Faces at one edge with one label belong together: sorted by edge and label, they are neighbours.
    keys = np.column_stack([ends[real], labels[face[real]]])
    face = face[real]
    order = np.lexsort(keys.T)
    keys, face = keys[order], face[order]
    same = (keys[1:] == keys[:-1]).all(1)
    a, b = face[:-1][same], face[1:][same]
    root = np.arange(len(labels))
    while True:
        least = np.minimum(root[a], root[b])
        before = root.copy()
        np.minimum.at(root, root[a], least)
        np.minimum.at(root, root[b], least)
        while (root != root[root]).any():
            root = root[root]
        if (root == before).all():
            break
    pieces = np.bincount(labels[np.unique(root[area > 0])])
    return int((pieces > 1).sum())


def score(mesh, labels):
    """Number of clusters, energy in source units, hexagon ratio and connectivity of one label a face."""
    vertices, corners, first = mesh
    labels = np.asarray(labels).astype(np.int64)
    faces = len(first) - 1
    assert labels.shape == (faces,), f"{labels.shape} labels for {faces} faces"

    triangles, face = fans(corners, first)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    area = np.sqrt((np.cross(b - a, c - a) ** 2).sum(1)) / 2
    middle = (a + b + c) / 3
    face_area = np.bincount(face, area, faces)
    moment = np.stack([np.bincount(face, area * middle[:, axis], faces) for axis in range(3)], 1)
    centroid = moment / np.where(face_area > 0, face_area, 1)[:, None]

    k = len(np.unique(labels))
    weight = np.bincount(labels, face_area)
    proxy = np.stack([np.bincount(labels, face_area * centroid[:, axis]) for axis in range(3)], 1)
    proxy /= np.where(weight > 0, weight, 1)[:, None]
    energy = float((face_area * ((centroid - proxy[labels]) ** 2).sum(1)).sum())

    # What lies inside the faces is no choice of the clustering: it is taken off the energy of the hexagons.
    edges = ((a - b) ** 2).sum(1) + ((b - c) ** 2).sum(1) + ((c - a) ** 2).sum(1)
    inside = float((area * (edges / 36 + ((middle - centroid[face]) ** 2).sum(1))).sum())
    tiling = 5 / (18 * np.sqrt(3)) * float(face_area.sum()) ** 2 / k
    rest = tiling - inside
    return {
        "faces": faces,
        "clusters": k,
        "largest_label": int(labels.max()),
        "energy": energy,
        "hexagon_ratio": energy / rest if rest >= tiling / 2 else None,
        "disconnected_clusters": disconnected(vertices, corners, first, labels, face_area),
    }


if __name__ == "__main__":
    print(json.dumps(score(load(sys.argv[1]), np.load(sys.argv[2]))))
