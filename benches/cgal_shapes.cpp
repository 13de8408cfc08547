// Labels of CGAL for `tesserae evaluate shapes`: cgal_shapes IN.obj OUT.npy vsa K | ransac EPSILON
//
// vsa: variational shape approximation by normals (the metric L2,1), hierarchical seeds, 50 iterations. ransac: planes,
// spheres and cylinders at the centres of faces, EPSILON a share of the diagonal; faces that it leaves out have a label
// of their own. Needs CGAL 5.5 or later:
//     g++ -O2 -std=c++17 benches/cgal_shapes.cpp -o cgal_shapes -lgmp -lmpfr

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/bbox.h>
#include <CGAL/Polygon_mesh_processing/compute_normal.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_approximation/approximate_triangle_mesh.h>
#include <CGAL/property_map.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <iostream>
#include <string>
#include <tuple>
#include <vector>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Labels = std::vector<std::uint32_t>;
namespace processing = CGAL::Polygon_mesh_processing;
namespace approximation = CGAL::Surface_mesh_approximation;

Labels vsa(Mesh& mesh, std::size_t clusters) {
    auto proxies = mesh.add_property_map<Mesh::Face_index, std::size_t>("f:proxy", 0).first;
    approximation::approximate_triangle_mesh(
        mesh, CGAL::parameters::verbose_level(approximation::SILENT)
                  .seeding_method(approximation::HIERARCHICAL)
                  .max_number_of_proxies(clusters)
                  .number_of_iterations(50)
                  .face_proxy_map(proxies));
    Labels labels;
    for (const auto face : mesh.faces()) {
        labels.push_back(static_cast<std::uint32_t>(proxies[face]));
    }
    return labels;
}

Labels ransac(const Mesh& mesh, double share) {
    // a face with its number, since the search changes their order
    using Oriented = std::tuple<Kernel::Point_3, Kernel::Vector_3, std::size_t>;
    using First = CGAL::Nth_of_tuple_property_map<0, Oriented>;
    using Second = CGAL::Nth_of_tuple_property_map<1, Oriented>;
    using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, std::vector<Oriented>, First, Second>;

    std::vector<Oriented> centres;
    for (const auto face : mesh.faces()) {
        const auto corners = mesh.vertices_around_face(mesh.halfedge(face));
        Kernel::Vector_3 sum(0, 0, 0);
        for (const auto corner : corners) {
            sum += mesh.point(corner) - CGAL::ORIGIN;
        }
        centres.emplace_back(CGAL::ORIGIN + sum / static_cast<double>(corners.size()),
                             processing::compute_face_normal(face, mesh), centres.size());
    }
    const auto box = processing::bbox(mesh);
    const double diagonal = std::sqrt(std::pow(box.xmax() - box.xmin(), 2) + std::pow(box.ymax() - box.ymin(), 2) +
                                      std::pow(box.zmax() - box.zmin(), 2));
    CGAL::get_default_random() = CGAL::Random(1);
    CGAL::Shape_detection::Efficient_RANSAC<Traits> search;
    search.set_input(centres);
    search.add_shape_factory<CGAL::Shape_detection::Plane<Traits>>();
    search.add_shape_factory<CGAL::Shape_detection::Sphere<Traits>>();
    search.add_shape_factory<CGAL::Shape_detection::Cylinder<Traits>>();
    CGAL::Shape_detection::Efficient_RANSAC<Traits>::Parameters parameters;
    parameters.probability = 0.01;
    parameters.min_points = 50;
    parameters.epsilon = share * diagonal;
    parameters.cluster_epsilon = 0.05 * diagonal;
    parameters.normal_threshold = 0.9;
    search.detect(parameters);
    const auto shapes = search.shapes();
    Labels labels(centres.size(), static_cast<std::uint32_t>(shapes.size()));
    std::uint32_t number = 0;
    for (const auto& shape : shapes) {
        for (const auto face : shape->indices_of_assigned_points()) {
            labels[std::get<2>(centres[face])] = number;
        }
        ++number;
    }
    return labels;
}

int main(int count, char** words) {
    Mesh mesh;
    if (count < 5 || !CGAL::IO::read_polygon_mesh(words[1], mesh)) {
        std::cerr << "usage: cgal_shapes IN.obj OUT.npy vsa K | ransac EPSILON\n";
        return 1;
    }
    const Labels labels =
        std::string(words[3]) == "vsa" ? vsa(mesh, std::stoul(words[4])) : ransac(mesh, std::stod(words[4]));
    const std::string count_of_labels = std::to_string(labels.size());
    std::string header = "{'descr': '<u4', 'fortran_order': False, 'shape': (" + count_of_labels + ",), }";
    header.resize((10 + header.size()) / 64 * 64 + 53, ' ');
    header += '\n';
    std::ofstream out(words[2], std::ios::binary);
    out.write("\x93NUMPY\x01\x00", 8);
    const std::uint16_t length = static_cast<std::uint16_t>(header.size());
    out.write(reinterpret_cast<const char*>(&length), 2);
    out.write(header.data(), static_cast<std::streamsize>(header.size()));
    out.write(reinterpret_cast<const char*>(labels.data()), static_cast<std::streamsize>(4 * labels.size()));
    return out ? 0 : 1;
}
