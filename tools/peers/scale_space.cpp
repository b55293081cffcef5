// scale_space CLOUD MESH: CGAL's scale space surface reconstruction: four steps of smoothing, then alpha shapes that are kept manifold, as in its manual's example of that.
#include "io.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Scale_space_reconstruction_3/Alpha_shape_mesher.h>
#include <CGAL/Scale_space_reconstruction_3/Weighted_PCA_smoother.h>
#include <CGAL/Scale_space_surface_reconstruction_3.h>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Smoother = CGAL::Scale_space_reconstruction_3::Weighted_PCA_smoother<Kernel>;
using Mesher = CGAL::Scale_space_reconstruction_3::Alpha_shape_mesher<Kernel>;

int main(int, char **arguments)
{
    std::vector<Kernel::Point_3> points;
    read_cloud(arguments[1], [&](double x, double y, double z) { points.emplace_back(x, y, z); });
    CGAL::Scale_space_surface_reconstruction_3<Kernel> reconstruct(points.begin(), points.end());
    // Ten neighbours, 200 samples; shells not apart, manifold.
    Smoother smoother(10, 200);
    reconstruct.increase_scale(4, smoother);
    reconstruct.reconstruct_surface(Mesher(smoother.squared_radius(), false, true));
    // Facets are numbers of the points as they were given.
    std::vector<std::array<double, 3>> vertices;
    for (const auto &p : points) vertices.push_back({p.x(), p.y(), p.z()});
    std::vector<Triangle> triangles;
    for (auto f = reconstruct.facets_begin(); f != reconstruct.facets_end(); ++f)
        triangles.push_back({std::uint32_t((*f)[0]), std::uint32_t((*f)[1]), std::uint32_t((*f)[2])});
    write_mesh(arguments[2], vertices, triangles);
}
