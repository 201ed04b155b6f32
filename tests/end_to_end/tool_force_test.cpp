// Force vector on the tool, in all files of a run.

#include <Eigen/Geometry>

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

// Nodal reactions in the file for ParaView are summed here.
TEST(ToolForce, TheVectorAndTheMomentAreTheSumOfTheReactionsInTheNodesFile) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom brain.nrrd --spacing 2 -q");
  for (const char* contact : {"bonded", "frictionless"}) {
    // The place is off the dome's middle, so that the tissue presses sideways.
    good(folder, std::string("run brain.nrrd -o out --force -q --nodes 600 --depth 3mm --frames 2 --band off "
                             "--write nodes --indent-at 20,8,top --direction 0,0,-1 --contact ") +
                     contact);
    const auto summary = summary_of(folder / "out");
    const auto three = [](const nlohmann::json& list) { return Vec3(list.at(0), list.at(1), list.at(2)); };
    const Vec3 approach = three(summary["counts"]["push"]);
    const Vec3 reference = 1e-3 * three(summary["counts"]["circle_centre_mm"]) + 3e-3 * approach;
    const PointFile nodes = read_vtu(folder / "out" / "nodes" / "nodes_0002.vtu");
    const auto &set = nodes.find("node_set")->values, &reaction = nodes.find("reaction_N")->values,
               &moved = nodes.find("nodal_parameter_mm")->values;
    Vec3 force = Vec3::Zero(), moment = Vec3::Zero();
    for (Index a = 0; a < set.cols(); ++a) {
      if (set(0, a) != 2.0) continue;
      Vec3 holds = reaction.col(a);
      if (std::string(contact) == "frictionless") holds = holds.dot(approach) * approach;
      force -= holds;
      moment -= (1e-3 * Vec3(nodes.position_mm.col(a) + moved.col(a)) - reference).cross(holds);
    }
    const Table curve = read_csv(folder / "out" / "force.csv");
    EXPECT_EQ(curve.header[2], "force_N");
    EXPECT_EQ(curve.header.back(), "moment_z_Nm");
    const auto last = [&](const char* name) { return curve.find(name)->back(); };
    const Vec3 written(last("force_x_N"), last("force_y_N"), last("force_z_N"));
    const Vec3 turned(last("moment_x_Nm"), last("moment_y_Nm"), last("moment_z_Nm"));
    EXPECT_LT((written - force).norm(), 1e-5 * force.norm());
    EXPECT_LT((turned - moment).norm(), 1e-5 * force.norm() * 5e-3);
    EXPECT_NEAR(-written.dot(approach), last("force_N"), 1e-5 * force.norm());
    EXPECT_LT((three(summary["force_on_tool_N"]) - written).norm(), 1e-6 * force.norm());
    EXPECT_LT((three(summary["moment_on_tool_Nm"]) - turned).norm(), 1e-6 * turned.norm() + 1e-15);
    const double lateral = (written - written.dot(approach) * approach).norm() / written.norm();
    EXPECT_NEAR(summary["lateral_share"], lateral, 1e-6);
    if (std::string(contact) == "bonded") {
      EXPECT_GT(lateral, 0.02);
    } else {
      EXPECT_LT(lateral, 1e-6);
    }
  }
}

}  // namespace
}  // namespace dimple
