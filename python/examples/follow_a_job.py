"""Cluster a mesh at a service, and watch its energy fall.

    python follow_a_job.py http://127.0.0.1:8080 mesh.obj 1000
"""

from __future__ import annotations

import sys

import tesserae_mesh


def main(url: str, mesh: str, clusters: int) -> None:
    with tesserae_mesh.Client(url) as client:
        job = client.submit(mesh, clusters=clusters, keep_mesh=True)
        for event in job.events():
            if event.kind == "iteration":
                print(f"{event.data['phase']:10} {event.data['energy']:.6e}")
        report = job.wait().report()
        print(f"{report['clusters']} clusters, hexagon ratio {report['energy']['hexagon_ratio']}")
        print(f"{len(job.labels())} labels, {len(job.boundaries()['curves'])} curves between clusters")
        job.save("remesh.ply")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
