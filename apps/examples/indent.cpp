// Dimple as a library: from a label image to a force curve, and a tool moved by hand.
//
//     indent IMAGE [DEPTH_MM]

#include <cstdio>
#include <cstdlib>
#include <dimple/io/error.hpp>
#include <dimple/io/label_image.hpp>
#include <dimple/preprocess/build_model.hpp>
#include <dimple/preprocess/supports/support.hpp>
#include <dimple/solver/session.hpp>
#include <dimple/solver/solve.hpp>

int main(int argc, char** argv) try {
  if (argc < 2) return std::fprintf(stderr, "usage: indent IMAGE [DEPTH_MM]\n"), 2;
  const double depth =
      argc > 2 ? 1e-3 * std::atof(argv[2]) : 2e-3;  // metres: all but images and files are SI

  // Image to model: surface, base, bonded patch, nodes, integration points, supports.
  dimple::ModelOptions options;
  options.node_set.count = 1000;  // nodes
  dimple::BuiltModel built = dimple::build_model(dimple::read_label_image(argv[1]), {}, options);
  std::printf("%ld nodes, %s\n", static_cast<long>(built.model.node_count()),
              built.report.boundary.patch_reason.c_str());

  // Model to curve.
  const dimple::Material brain = dimple::neo_hookean(210.0, 0.499, 1000.0);  // Pa, -, kg/m^3
  for (const dimple::ForceSample& now :
       dimple::solve(built.model, {{brain}, built.model.tissue}, {.depth = depth}, {.frames = 4}).force)
    std::printf("%.2f mm  %.5f N\n", 1e3 * now.depth, now.force);

  // Interactive: steps of 0.1 mm, with force and surface after each.
  dimple::Session session(std::move(built.model), {brain});
  const dimple::Interpolation skin = dimple::surface_interpolation(session.model());
  for (double d = 1e-4; d < 1.05e-3; d += 1e-4) {
    session.equilibrate(d);
    const Eigen::MatrixXd moved = skin(session.nodal_parameters());  // 3 x vertices, metres
    std::printf("%.1f mm  %.5f N, skin moved by up to %.2f mm\n", 1e3 * d, session.force(),
                1e3 * moved.colwise().norm().maxCoeff());
  }
} catch (const dimple::Error& error) {
  std::fprintf(stderr, "%s\n%s\n", error.report.fact.c_str(), error.report.remedy.c_str());
  return static_cast<int>(error.code);
}
