// What the drivers share: a cloud of our own PLY files in (records of 3 or 6 floats: x y z, or with nx ny nz), a mesh out, and times of steps.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

using Triangle = std::array<std::uint32_t, 3>;

// Calls `push(x, y, z)` for each point.
template <class Push> void read_cloud(const char *path, Push push)
{
    std::ifstream in(path, std::ios::binary);
    std::string line;
    std::size_t points = 0, fields = 0;
    while (std::getline(in, line) && line != "end_header") {
        if (line.rfind("element vertex ", 0) == 0) points = std::stoull(line.substr(15));
        if (line.rfind("property float ", 0) == 0) ++fields;
    }
    if (!in || fields < 3) throw std::runtime_error(std::string(path) + ": no cloud of this tool");
    std::vector<float> record(fields);
    for (std::size_t i = 0; i < points; ++i) {
        if (!in.read(reinterpret_cast<char *>(record.data()), fields * sizeof(float))) throw std::runtime_error(std::string(path) + ": cut off");
        push(record[0], record[1], record[2]);
    }
}

inline void write_mesh(const char *path, const std::vector<std::array<double, 3>> &vertices, const std::vector<Triangle> &triangles)
{
    std::ofstream out(path, std::ios::binary);
    out << "ply\nformat binary_little_endian 1.0\nelement vertex " << vertices.size() << "\nproperty double x\nproperty double y\nproperty double z\nelement face "
        << triangles.size() << "\nproperty list uchar uint vertex_indices\nend_header\n";
    out.write(reinterpret_cast<const char *>(vertices.data()), vertices.size() * sizeof(vertices[0]));
    for (const Triangle &triangle : triangles) {
        out.put(3);
        out.write(reinterpret_cast<const char *>(triangle.data()), sizeof triangle);
    }
    if (!out.flush()) throw std::runtime_error(std::string(path) + ": cannot be written");
}

// Of a CGAL surface mesh.
template <class Mesh> void write_surface_mesh(const char *path, const Mesh &mesh)
{
    std::vector<std::array<double, 3>> vertices;
    std::vector<std::uint32_t> number(mesh.num_vertices() + mesh.number_of_removed_vertices());
    for (auto v : mesh.vertices()) {
        const auto &p = mesh.point(v);
        number[v] = vertices.size();
        vertices.push_back({p.x(), p.y(), p.z()});
    }
    std::vector<Triangle> triangles;
    for (auto f : mesh.faces()) {
        auto h = mesh.halfedge(f);
        triangles.push_back({number[mesh.source(h)], number[mesh.target(h)], number[mesh.target(mesh.next(h))]});
    }
    write_mesh(path, vertices, triangles);
}

// Says how long a step took, for the tool to read.
struct Step {
    std::string name;
    std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
    explicit Step(std::string name) : name(std::move(name)) {}
    ~Step() { std::printf("step %s %.6f\n", name.c_str(), std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()); }
};
