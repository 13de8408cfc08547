// CGAL's remesh of a mesh, for benches/remesh.py: cgal_remesh IN OUT CLUSTERS [qem]; prints milliseconds.
// Needs CGAL 6.1 or later, and Eigen.

#include <CGAL/Polygon_mesh_processing/IO/polygon_mesh_io.h>
#include <CGAL/Polygon_mesh_processing/approximated_centroidal_Voronoi_diagram_remeshing.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>

#include <chrono>
#include <iostream>
#include <string>

int main(int count, char** words) {
    namespace processing = CGAL::Polygon_mesh_processing;
    using Point = CGAL::Simple_cartesian<double>::Point_3;

    CGAL::Surface_mesh<Point> mesh;
    if (count < 4 || !processing::IO::read_polygon_mesh(words[1], mesh)) {
        std::cerr << "usage: cgal_remesh IN OUT CLUSTERS [qem]\n";
        return 1;
    }
    const bool with_quadrics = count > 4;
    const auto started = std::chrono::steady_clock::now();
    processing::approximated_centroidal_Voronoi_diagram_remeshing(
        mesh, std::stoul(words[3]),
        CGAL::parameters::use_postprocessing_qem(with_quadrics).random_seed(1));
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - started;
    mesh.collect_garbage();
    if (!CGAL::IO::write_polygon_mesh(words[2], mesh, CGAL::parameters::stream_precision(17))) {
        return 1;
    }
    std::cout << took.count() << '\n';
}
