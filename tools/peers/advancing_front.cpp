// advancing_front CLOUD MESH: CGAL's advancing front surface reconstruction, at its defaults.
#include "io.h"

#include <CGAL/Advancing_front_surface_reconstruction.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>

using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;

int main(int, char **arguments)
{
    std::vector<Point> points;
    read_cloud(arguments[1], [&](double x, double y, double z) { points.emplace_back(x, y, z); });
    std::vector<std::array<std::size_t, 3>> facets;
    CGAL::advancing_front_surface_reconstruction(points.begin(), points.end(), std::back_inserter(facets));
    std::vector<std::array<double, 3>> vertices;
    for (const Point &p : points) vertices.push_back({p.x(), p.y(), p.z()});
    std::vector<Triangle> triangles;
    for (const auto &f : facets) triangles.push_back({std::uint32_t(f[0]), std::uint32_t(f[1]), std::uint32_t(f[2])});
    write_mesh(arguments[2], vertices, triangles);
}
