"""Meshes, remeshes and submeshes as Blender opens them: faces, clusters, colours.

    python blender.py BINARY [MESHES]

Needs the package `bpy` (Blender as a module, 500 MB, one version of Python each), so it is not part of `make test`;
`make blender` runs it. MESHES is a folder of meshes; a sample made by BINARY is used as well.

Blender takes the colours of a GLB and of vertices of a PLY. Its readers of PLY and OBJ drop properties of faces.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

import bpy
import numpy as np

import colours

BINARY = pathlib.Path(sys.argv[1]).resolve()
MESHES = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else None


def run(*command):
    subprocess.run([str(word) for word in command], check=True, capture_output=True)


def colour(cluster):
    return [channel / 255 for channel in colours.of_cluster(cluster)]


def opened(path, **options):
    """The meshes of a file, by name."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    readers = {".glb": bpy.ops.import_scene.gltf, ".ply": bpy.ops.wm.ply_import, ".obj": bpy.ops.wm.obj_import}
    assert readers[path.suffix](filepath=str(path), **options) == {"FINISHED"}, path
    return {thing.name: thing.data for thing in bpy.data.objects if thing.type == "MESH"}


def corner_colours(mesh):
    """The colour of the first corner of each face, as it is stored."""
    layer = mesh.color_attributes[0]
    found = np.empty(4 * len(layer.data), dtype=np.float32)
    layer.data.foreach_get("color_srgb", found)
    first = [face.loop_start for face in mesh.polygons]
    if layer.domain == "POINT":
        first = [mesh.loops[corner].vertex_index for corner in first]
    return found.reshape(-1, 4)[first, :3]


def lighter(colours):
    """What sRGB becomes when it is read as linear, as glTF has it (docs/results.md)."""
    return np.where(colours <= 0.0031308, 12.92 * colours, 1.055 * colours ** (1 / 2.4) - 0.055)


def check_colours(found, expected, what):
    off = abs(found - expected).max()
    assert off < 0.01, f"{what}: a colour is off by {off}"


def check(mesh, clusters, folder):
    labels_file = folder / "labels.npy"
    run(BINARY, "cluster", mesh, "-k", clusters, "--labels", labels_file, "--device", "cpu")
    labels = np.load(labels_file)
    colours = np.array([colour(cluster) for cluster in range(clusters)])

    def export(flag, name, *more):
        run(BINARY, "export", mesh, "--labels", labels_file, flag, folder / name, *more)
        return folder / name

    part, = opened(export("--mesh", "mesh.glb")).values()
    assert len(part.polygons) == len(labels), "mesh.glb"
    found = corner_colours(part)
    check_colours(found, lighter(colours)[labels], "mesh.glb")
    try:
        check_colours(found, lighter(colours)[np.roll(labels, 1)], "other labels")
    except AssertionError:
        pass
    else:
        raise AssertionError("colours of other labels are not noticed")

    part, = opened(export("--mesh", "mesh.ply", "--ply-vertex-colours")).values()
    assert len(part.polygons) == len(labels), "mesh.ply"
    check_colours(corner_colours(part), colours[labels], "mesh.ply")
    ids = np.array([part.attributes["cluster"].data[face.vertices[0]].value for face in part.polygons])
    assert (ids == labels).all(), "mesh.ply: clusters"

    parts = opened(export("--mesh", "mesh.obj"), use_split_groups=True)
    assert sorted(len(part.polygons) for part in parts.values()) == sorted(np.bincount(labels)), "mesh.obj: groups"

    parts = opened(export("--submeshes", "submeshes.glb"))
    assert len(parts) == clusters, "submeshes.glb"
    for cluster, size in enumerate(np.bincount(labels)):
        assert len(parts[f"cluster-{cluster}"].polygons) == size, f"submeshes.glb: cluster {cluster}"

    sizes = set()
    for name in ["remesh.glb", "remesh.ply", "remesh.obj"]:
        part, = opened(export("--remesh", name)).values()
        # validate() is true where it had to mend something
        assert not part.validate(verbose=True), name
        sizes.add((len(part.vertices), len(part.polygons)))
    assert len(sizes) == 1, f"remeshes differ: {sizes}"
    print(f"{mesh.name}: {len(labels)} faces, {clusters} clusters, remesh {sizes.pop()}")


def main():
    print(f"Blender {bpy.app.version_string}")
    with tempfile.TemporaryDirectory(prefix="tesserae-") as temporary:
        folder = pathlib.Path(temporary)
        sample = folder / "knot.glb"
        run(BINARY, "sample", "knot", "--faces", 3000, sample)
        meshes = [(sample, 40)]
        for name, clusters in [("spot.obj", 60), ("stanford-bunny.glb", 150)]:
            if MESHES and (MESHES / name).exists():
                meshes.append((MESHES / name, clusters))
        for mesh, clusters in meshes:
            check(mesh, clusters, folder)
    # Blender as a module crashes when the interpreter ends
    sys.stdout.flush()
    os._exit(0)


main()
