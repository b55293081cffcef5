// poisson CLOUD MESH DISTANCE: CGAL's Poisson surface reconstruction with normals of its own. DISTANCE is that of the surface to its triangles, in mean spacings; its default
// is .375.
#include "io.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/compute_average_spacing.h>
#include <CGAL/jet_estimate_normals.h>
#include <CGAL/mst_orient_normals.h>
#include <CGAL/poisson_surface_reconstruction.h>
#include <CGAL/property_map.h>

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Oriented = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using First = CGAL::First_of_pair_property_map<Oriented>;
using Second = CGAL::Second_of_pair_property_map<Oriented>;

int main(int, char **arguments)
{
    // As many neighbours as in the manual.
    const unsigned neighbours = 18;
    std::vector<Oriented> points;
    read_cloud(arguments[1], [&](double x, double y, double z) { points.emplace_back(Kernel::Point_3(x, y, z), Kernel::Vector_3()); });
    const auto named = CGAL::parameters::point_map(First()).normal_map(Second());
    {
        Step step("normals");
        CGAL::jet_estimate_normals<CGAL::Sequential_tag>(points, neighbours, named);
        // What cannot be oriented has been moved to the end.
        points.erase(CGAL::mst_orient_normals(points, neighbours, named), points.end());
    }
    const double spacing = CGAL::compute_average_spacing<CGAL::Sequential_tag>(points, 6, CGAL::parameters::point_map(First()));
    CGAL::Surface_mesh<Kernel::Point_3> mesh;
    if (!CGAL::poisson_surface_reconstruction_delaunay(points.begin(), points.end(), First(), Second(), mesh, spacing, 20.0, 30.0, std::atof(arguments[3]))) return 1;
    write_surface_mesh(arguments[2], mesh);
}
