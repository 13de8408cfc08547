"""Cluster a mesh at a service, and watch its energy fall.

    python follow_a_job.py http://127.0.0.1:8080 mesh.obj 1000
"""

from __future__ import annotations

import argparse

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
    parser = argparse.ArgumentParser(description="Cluster a mesh at a service, and watch its energy fall.")
    parser.add_argument("url", help="of the service, such as http://127.0.0.1:8080")
    parser.add_argument("mesh", help="name of the file")
    parser.add_argument("clusters", type=int, help="number of clusters")
    main(**vars(parser.parse_args()))
