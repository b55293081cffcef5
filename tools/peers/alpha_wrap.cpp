// alpha_wrap CLOUD MESH ALPHA: CGAL's alpha wrap; ALPHA is that share of the box's diagonal (20: a twentieth), and the offset a thirtieth of it, as in the manual's 20 and 600.
#include "io.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/alpha_wrap_3.h>
#include <CGAL/bounding_box.h>

using Point = CGAL::Exact_predicates_inexact_constructions_kernel::Point_3;

int main(int, char **arguments)
{
    std::vector<Point> points;
    read_cloud(arguments[1], [&](double x, double y, double z) { points.emplace_back(x, y, z); });
    const auto box = CGAL::bounding_box(points.begin(), points.end());
    const double alpha = std::sqrt(CGAL::squared_distance((box.min)(), (box.max)())) / std::atof(arguments[3]);
    CGAL::Surface_mesh<Point> mesh;
    CGAL::alpha_wrap_3(points, alpha, alpha / 30, mesh);
    write_surface_mesh(arguments[2], mesh);
}
