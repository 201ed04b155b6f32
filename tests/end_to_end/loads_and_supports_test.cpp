// Gravity, pressures and supports, from a user's options to the files of a run.

#include <vtkDataArray.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <Eigen/Geometry>
#include <cstdio>

#include "io/types.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

// A block of 60 x 60 x 30 mm on its inferior face, with the tool in the middle of the superior one.
class Block : public InFolder {
 protected:
  const std::string scene = " --base inferior --indent-at 0,0,top --frames 2 -q";

  void SetUp() override { make_block(); }
  Json run(const std::string& options, const std::string& out = "out", const std::string& mu = "2kPa") const {
    good("run block.nrrd --force -o " + out + scene + " --mu " + mu + options);
    return summary(out);
  }
  std::string force(const std::string& out = "out") const { return text(fs::path(out) / "force.csv"); }
};

using GravityInAScene = Block;

TEST_F(GravityInAScene, BySideAndByNumbersGivesTheSameBits) {
  const std::string indenter = " --nodes 600 --depth 0.5mm --write force";
  run(indenter + " --gravity inferior");
  const std::string by_side = force();
  run(indenter + " --gravity 0,0,-9.81");
  EXPECT_EQ(force(), by_side);
  run(indenter);
  EXPECT_NE(force(), by_side);
}

// The reported settlement is the longest nodal displacement, not the largest nodal parameter. A warning says
// that damping is not used.
TEST_F(GravityInAScene, PreloadsByWhatItsNodesAreDisplaced) {
  good("run block.nrrd --force -o out" + scene +
       " --mu 2kPa --nodes 600 --depth 0.5mm --write nodes --gravity left --damping 3");
  vtkNew<vtkXMLUnstructuredGridReader> nodes;
  nodes->SetFileName((folder / "out/nodes/nodes_0000.vtu").c_str());
  nodes->Update();
  vtkDataArray* moved = nodes->GetOutput()->GetPointData()->GetArray("displacement_mm");
  ASSERT_NE(moved, nullptr);
  const Json summary = Json::parse(text_of(folder / "out/summary.json"));
  EXPECT_NEAR(summary["loads"]["settled_mm"], moved->GetMaxNorm(), 1e-4);
  EXPECT_THAT(summary["warnings"].dump(), HasSubstr("3 1/s of damping is not used"));
}

// The body sags sideways under its weight; files show the tool at the present place of the bonded patch.
TEST_F(GravityInAScene, CarriesTheToolInFilesAndPicturesToWhereThePatchIs) {
  const Json summary = run(" --nodes 600 --depth 0.5mm --write nodes,surface --gravity left");
  const PointFile nodes = read_vtu(folder / "out" / "nodes" / "nodes_0002.vtu");
  const Field *set = nodes.find("node_set"), *u = nodes.find("displacement_mm");
  ASSERT_TRUE(set && u);
  Vec3 moved = Vec3::Zero();
  double count = 0.0;
  for (Index a = 0; a < nodes.position_mm.cols(); ++a)
    if ((static_cast<int>(set->values(0, a)) & 2) != 0) moved += u->values.col(a), count += 1.0;
  moved /= count;
  ASSERT_GT(moved.head<2>().norm(), 0.5);
  const SurfaceFile tool = read_vtp(folder / "out" / "tool" / "tool_0002.vtp");
  const Vec3 axis = tool.position_mm.rowwise().mean();  // at rest through x = y = 0
  EXPECT_LT((axis - moved).head<2>().norm(), 0.1) << axis.transpose() << '\n' << moved.transpose();
  EXPECT_LT((vector_of(summary["loads"]["circle_moved_mm"]) - moved).head<2>().norm(), 0.1);
}

// Before the tool moves, gravity does several times the tool's work; the error is relative to the latter.
TEST_F(GravityInAScene, IsNoWorkOfTheTool) {
  const Json summary = run(" --nodes 600 --depth 2mm --write force --gravity inferior", "out", "500Pa");
  const Table energy = read_csv(folder / "out" / "energy.csv");
  const std::vector<double>&work = *energy.find("external_work_J"), &error = *energy.find("error_J");
  ASSERT_GT(work.front(), 2.0 * (work.back() - work.front()));
  double largest = 0.0;
  for (const double e : error) largest = std::max(largest, std::abs(e));
  EXPECT_NEAR(summary["energy_error"], largest / (work.back() - work.front()), 1e-6);
  EXPECT_THAT(summary["verdict"]["energy"]["of"].get<std::string>(), HasSubstr("since the preload"));
}

TEST_F(GravityInAScene, ThatCrushesTheBodyIsReportedAndThatDisplacesItALittleIsNot) {
  const auto warned = [&](const char* mu) {
    return run(" --nodes 600 --depth 0.1mm --write force --gravity left", "out", mu)["warnings"].dump().find(
               "more than half of its smallest extent") != std::string::npos;
  };
  EXPECT_FALSE(warned("2kPa"));
  EXPECT_TRUE(warned("300Pa"));
}

TEST_F(GravityInAScene, IsBorneByTheBaseWhereTheToolIsBarelyInContact) {
  const Json summary = run(" --nodes 800 --depth 0.01mm --write force --gravity inferior");
  const double weight = 1e-3 * summary["mass_g"].get<double>() * 9.81;
  const Table curve = read_csv(folder / "out" / "force.csv");
  EXPECT_NEAR(curve.find("base_force_N")->front(), weight, 1e-3 * weight);
  EXPECT_NEAR(curve.find("force_N")->front(), 0.0, 1e-3 * weight);
  EXPECT_NEAR(curve.find("base_force_N")->back() - curve.find("force_N")->back(), weight, 1e-3 * weight);
  EXPECT_LT(summary["momentum_error"], 1e-3) << "the tissue's own forces add up to nothing";
  EXPECT_TRUE(summary["band"].contains("unknown")) << summary["band"];
  EXPECT_FALSE(summary["band"].contains("low_N")) << summary["band"];
}

const std::string supports =
    " --set support.retractor.on=left --set support.retractor.move=-1,0,0 "
    "--set support.plate.on=right --set support.plate.hold=sliding";
const std::string everything =
    supports +
    " --gravity inferior --set load.pressure.csf.pressure=20Pa --set load.pressure.csf.on=anterior";

TEST_F(Block, UnderLoadsAndOnSupportsGivesTheSameBitsWithAnyNumberOfThreads) {
  for (const char* threads : {"1", "2", "3"})
    run(std::string(" --nodes 700 --depth 1mm --write nodes --threads ") + threads + everything, threads);
  for (const char* threads : {"2", "3"}) {
    EXPECT_EQ(force("1"), force(threads));
    EXPECT_TRUE(text_of(folder / "1/nodes/nodes_0002.vtu") ==
                text_of(folder / threads / "nodes/nodes_0002.vtu"))
        << threads;
  }
}

TEST_F(Block, UnderLoadsAndOnSupportsIsResumedToTheSameBits) {
  const std::string slow =
      "run block.nrrd --base inferior --indent-at 0,0,top --mu 2kPa -q --nodes 700 --depth 4mm --frames 100 "
      "--write nodes --quantity displacement@0,0,25" +
      everything;
  good(slow + " -o whole");
  stopped_at_checkpoint(folder, slow + " -o out", SIGTERM);
  good(slow + " -o out --resume");
  expect_same_results(folder / "whole", folder / "out");
}

TEST_F(Block, TakesAPressureFromAFile) {
  std::ofstream(folder / "csf.toml")
      << "[load.pressure.csf]\non = \"superior\"\npressure_Pa = 50\nfollows = \"no\"\n";
  const Json summary = run(" --nodes 800 --depth 0.01mm --write model --config csf.toml");
  EXPECT_EQ(summary["loads"]["pressure_Pa"]["csf"], 50.0);
  const double borne = read_csv(folder / "out" / "force.csv").find("base_force_N")->front();
  const SurfaceFile surface = read_vtp(folder / "out" / "model" / "surface.vtp");
  double area_mm2 = 0.0;  // of faces within 45 degrees of upwards, in projection
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const auto corner = [&](int k) { return Vec3(surface.position_mm.col(surface.triangles(k, t))); };
    const Vec3 twice = (corner(1) - corner(0)).cross(corner(2) - corner(0));
    if (twice.z() >= std::sqrt(0.5) * twice.norm()) area_mm2 += 0.5 * twice.z();
  }
  EXPECT_NEAR(area_mm2, 3600.0, 0.1 * 3600.0) << "the edges are round";
  EXPECT_NEAR(borne, 50.0 * 1e-6 * area_mm2, 1e-3 * borne);
  const std::string before = force();
  run(" --config out/config.resolved.toml");
  EXPECT_EQ(force(), before);
}

// A uniform pressure changes only the pressure in incompressible tissue and compresses other tissue slightly.
TEST_F(Block, ThatIsPressedFromAllAroundResistsTheToolAsWithoutThat) {
  const std::string ball = " --tool sphere:5mm --depth 3mm --nodes 1000 --nu 0.4999 --band off ";
  const double alone = run(ball + "--write force", "out", "210Pa")["force_N"];
  std::vector<double> preloads;
  for (const double p : {500.0, 2000.0, -1000.0}) {
    SCOPED_TRACE(p);
    const Json summary =
        run(ball + "--write points --set load.pressure.csf.pressure_Pa=" + std::to_string(p), "out", "210Pa");
    EXPECT_NEAR(summary["force_N"].get<double>() / alone, 1.0, 3e-3);
    EXPECT_NEAR(summary["base_force_N"].get<double>() / alone, 1.0, 3e-3) << "it has no resultant";
    EXPECT_LT(summary["energy_error"], 5e-3);
    preloads.push_back(summary["loads"]["settled_mm"].get<double>() / p);
    const PointFile points = read_vtu(folder / "out" / "points" / "points_0000.vtu");
    const Eigen::MatrixXd &stress = points.find("cauchy_stress_Pa")->values,
                          &volume = points.find("volume_mm3")->values;
    const Eigen::RowVectorXd mean = stress.topRows<3>().colwise().mean();
    EXPECT_NEAR(mean.dot(volume.row(0)) / volume.sum(), -p, 0.02 * std::abs(p)) << "the tissue bears it";
  }
  run(ball + "--write force --set load.pressure.csf.pressure=0Pa", "none", "210Pa");
  run(ball + "--write force", "without", "210Pa");
  EXPECT_NEAR(read_csv(folder / "none" / "force.csv").find("force_N")->back() / alone, 1.0, 1e-3);
  // With inertia, too, where tissue pressures follow from volumes.
  const std::string quick = " --depth 2mm --nodes 600 --nu 0.49 --time explicit --rate 10mm/s --write force ";
  const Json in_waves = run(quick + "--set load.pressure.csf.pressure=500Pa"), waves = run(quick);
  EXPECT_NEAR(in_waves["force_N"].get<double>() / waves["force_N"].get<double>(), 1.0, 0.02);
  EXPECT_LT(in_waves["energy_error"], 1e-3);
  EXPECT_NEAR(preloads[1] / preloads[0], 1.0, 0.1) << "in proportion to the pressure";
  EXPECT_LT(preloads[0], 0.04e-3) << "mm per Pa";
}

// Reactions in the file for ParaView, summed over its node sets.
TEST_F(Block, IsInBalanceWithToolBaseAndSupports) {
  const Json summary = run(" --nodes 1200 --depth 2mm --write nodes --gravity inferior" + supports);
  const PointFile nodes = read_vtu(folder / "out" / "nodes" / "nodes_0002.vtu");
  const auto &set = nodes.find("node_set")->values, &reaction = nodes.find("reaction_N")->values;
  const Vec3 approach = vector_of(summary["counts"]["push"]);
  // Supports are numbered in the order of their names.
  std::map<int, Vec3> on = {{1, Vec3::Zero()}, {2, Vec3::Zero()}, {4, Vec3::Zero()}, {8, Vec3::Zero()}};
  std::map<int, int> count;
  const Vec3 normal = vector_of(summary["supports"]["plate"]["force_N"]).normalized();
  for (Index a = 0; a < set.cols(); ++a) {
    const int bits = static_cast<int>(set(0, a));
    if (bits == 0) continue;
    ASSERT_TRUE(on.contains(bits)) << bits;
    const Vec3 holds = reaction.col(a);
    on[bits] -= bits == 4 ? Vec3(holds.dot(normal) * normal) : holds;
    ++count[bits];
  }
  const Json &plate = summary["supports"]["plate"], &retractor = summary["supports"]["retractor"];
  EXPECT_EQ(plate["nodes"], count[4]);
  EXPECT_EQ(retractor["nodes"], count[8]);
  EXPECT_GT(count[8], 10);
  EXPECT_EQ(vector_of(retractor["moved_mm"]), Vec3(-1, 0, 0));
  EXPECT_EQ(vector_of(plate["moved_mm"]), Vec3(0, 0, 0));
  const double largest = std::max({on[1].norm(), on[2].norm(), on[4].norm(), on[8].norm()});
  EXPECT_LT((vector_of(plate["force_N"]) - on[4]).norm(), 1e-5 * largest);
  EXPECT_LT((vector_of(retractor["force_N"]) - on[8]).norm(), 1e-5 * largest);
  EXPECT_NEAR(summary["force_N"], -on[2].dot(approach), 1e-5 * largest);
  EXPECT_NEAR(summary["base_force_N"], on[1].dot(approach), 1e-5 * largest);
  EXPECT_GT(on[8].x(), 0.0) << "pushed into the tissue, it is pushed back";
  const Vec3 weight(0, 0, -1e-3 * summary["mass_g"].get<double>() * 9.81);
  EXPECT_LT((on[1] + on[2] + on[4] + on[8] - weight).norm(), 1e-4 * largest);
}

using ASupport = Block;

TEST_F(ASupport, OnEachSideHasTheOppositeForceOfTheOther) {
  const std::string scene = " --nodes 6000 --depth 2mm --write force", left = " --set support.l.on=left",
                    right = " --set support.r.on=right";
  const double alone = run(scene)["force_N"].get<double>();
  const Json fixed = run(scene + left + right);
  const Json drawn = run(scene + left + right + " --set support.l.move=2,0,0 --set support.r.move=-2,0,0");
  for (const Json* summary : {&fixed, &drawn}) {
    const Vec3 l = vector_of((*summary)["supports"]["l"]["force_N"]),
               r = vector_of((*summary)["supports"]["r"]["force_N"]);
    EXPECT_LT((l - Vec3(-r.x(), r.y(), r.z())).norm(), 0.1 * l.norm())
        << l.transpose() << ", " << r.transpose();
    EXPECT_NE((*summary)["force_N"].get<double>(), alone);
  }
  EXPECT_LT(vector_of(drawn["supports"]["l"]["force_N"]).x(), -0.02) << "drawn outwards, it is drawn back";
  EXPECT_EQ(vector_of(drawn["supports"]["l"]["moved_mm"]), Vec3(2, 0, 0));
}

// Without an inverse for each direction it needed nine times as many, and found no equilibrium at larger
// depths.
TEST_F(ASupport, ThatSlidesNextToASlidingPatchTakesNoMoreEvaluationsThanThePatchAlone) {
  const std::string alone = " --nodes 600 --depth 1mm --band off --write force --contact frictionless";
  const double of_patch_alone = run(alone)["force_evaluations"].get<double>();
  EXPECT_LT(run(alone + " --set support.r.on=left --set support.r.hold=sliding")["force_evaluations"],
            1.5 * of_patch_alone);
}

TEST_F(ASupport, MayBeCalledIndenterAndTheForceIsTheSame) {
  for (const char* moves : {" --depth 1mm --set support.@.move=1,0,0",
                            " --set step.a.move=1mm --set step.b.moves=@ --set step.b.move=1,0,0"}) {
    const auto named = [&](const std::string& name) {
      std::string scene = std::string(" --nodes 600 --write force --set support.@.on=left") + moves;
      for (std::size_t at; (at = scene.find('@')) != std::string::npos;) scene.replace(at, 1, name);
      return run(scene)["force_on_tool_N"];
    };
    EXPECT_EQ(named("indenter"), named("retractor")) << moves;
  }
}

TEST_F(ASupport, KeepsForcesProportionalToTheModulus) {
  const std::string scene =
      " --nodes 600 --depth 1mm --write force --set support.r.on=left --set support.r.move=1,0,0";
  const Json known = run(scene, "out", "2kPa+-30%"), stiff = run(scene, "out", "2.6kPa");
  EXPECT_NEAR(known["band_of_mu"]["high_N"].get<double>() / stiff["force_N"].get<double>(), 1.0, 2e-4);
  const Vec3 one = vector_of(known["supports"]["r"]["force_N"]),
             other = vector_of(stiff["supports"]["r"]["force_N"]);
  EXPECT_LT((1.3 * one - other).norm(), 2e-4 * other.norm());
}

TEST_F(ASupport, MayBeTheTissueOfALabel) {
  good("phantom two.nrrd --shape block --size 60,60,30 --spacing 3 --two-labels -q");
  const std::string scene =
      " --base inferior --indent-at 0,0,top --mu 2kPa --frames 1 --nodes 800 --depth 2mm --write force "
      "--force -q";
  const auto force_of = [&](const std::string& more) {
    good("run two.nrrd -o out" + scene + more);
    return summary_of(folder / "out");
  };
  const Json held = force_of(" --set support.bone.on=label:1");
  EXPECT_GT(held["supports"]["bone"]["nodes"], 20);
  EXPECT_GT(held["force_N"], 1.02 * force_of("")["force_N"].get<double>()) << "a layer half as thick";
  refused(3, "run two.nrrd -o no -q --set support.bone.on=label:7",
          {"label '7'", "support.bone.on", "dimple info"});
  good("model two.nrrd -o model --nodes 500 -q");
  refused(4, "solve model -o no -q --depth 1mm --set support.bone.on=label:1",
          {"'bone'", "meets no node", "has no labels"});
}

TEST_F(Block, SaysAtTheStartWhatHoldsIt) {
  const Ran ran = good(
      "run block.nrrd -o out --base inferior --indent-at 0,0,top --nodes 600 --depth 0.5mm --frames 1 "
      "--write force --set support.retractor.on=left --set support.retractor.move=-3,0,0 "
      "--set support.plate.on=right --set support.plate.hold=sliding --set support.strap.on=anterior");
  EXPECT_THAT(ran.err, HasSubstr("support  retractor: "));
  EXPECT_THAT(ran.err, HasSubstr(" nodes, moves (-3, 0, 0) mm"));
  // The edges of a smooth surface around voxels are rounded, and not all alike.
  double x = 0.0, y = 0.0, z = 0.0;
  const std::size_t sliding = ran.err.find(" nodes, sliding, normal (");
  ASSERT_NE(sliding, std::string::npos) << ran.err;
  ASSERT_EQ(std::sscanf(ran.err.c_str() + sliding, " nodes, sliding, normal (%lf, %lf, %lf)", &x, &y, &z), 3);
  EXPECT_EQ(x, -1.0);
  EXPECT_LE(std::hypot(y, z), 0.02);
  EXPECT_THAT(ran.err, HasSubstr(" nodes, fixed"));
  EXPECT_THAT(ran.out, HasSubstr("no error estimate: not calibrated for supports"));
}

TEST_F(Block, WithoutTheLoadsUnderWhichItWasImagedIsNotSolvedWithAnythingOnAPartOfIt) {
  run(" --nodes 600 --depth 0.5mm --write model --gravity inferior --set load.imaged=loaded");
  refused(2, "solve out/model -o no -q --depth 0.5mm --gravity inferior --set support.r.on=left",
          {"the model is load-free", "chosen on the image's shape"});
}

TEST_F(Block, RefusesLoadsAndSupportsThatItDoesNotUnderstand) {
  const std::string
      start = "run block.nrrd -o no --force -q --base inferior --indent-at 0,0,top --nodes 600 --depth 1mm",
      pressure = "--set load.pressure.csf.";
  refuses(start, {{2, "--gravity sideways", {"gravity 'sideways'", "give inferior"}},
                  {2, "--gravity 0,1", {"gravity '0,1'"}},
                  {2, pressure + "on=lleft", {"'csf'", "'lleft'", "a side such as superior"}},
                  {2,
                   pressure + "pressure=1Pa " + pressure + "on=500,0,0,1",
                   {"meets no part of the surface", "it would act on nothing"}},
                  {2, pressure + "pressure=50N", {"pressure_Pa = 50N"}},
                  {2, "--set load.imaged=loaded", {"load.imaged=loaded is given, and there are no loads"}},
                  {5,
                   pressure + "pressure=1e9Pa " + pressure + "on=superior",
                   {"is not in equilibrium under its loads", "the tolerance is", "--set solver.tolerance"}}});
  refuses(start + " --set",
          {{2, "support.r.hold=fixed", {"'r' is nowhere", "support.r.on"}},
           {2, "support.r.om=left", {"there is no option 'support.r.om'"}},
           {2, "support.tool.on=left", {"a support is named 'tool'", "name it differently"}},
           {2, "support.base.on=left", {"a support is named 'base'", "name it differently"}},
           {2, "support.radius_factor.on=left", {"named 'radius_factor'", "moving least squares"}},
           {4,
            "tool.shape=sphere:5mm --set support.x.on=0,0,30,5",
            {"the support 'x' holds", "of the nodes under the tool", "--indent-at"}},
           {4,
            "tool.shape=sphere:5mm --set tool.o.shape=sphere:4mm --set tool.o.at=18,0,30 --set "
            "tool.o.move=1 --set support.x.on=18,0,30,6",
            {"the support 'x' holds", "of the nodes under the tool 'o'", "tool.o.at_mm"}}});
  refuses(start + " --set support.r.hold=sliding --set",
          {{2, "support.r.on=label:1", {"slides, and is the tissue of a label"}},
           {4, "support.r.on=left --set support.r.move=0,2,0", {"moves along the surface", "45 degrees"}}});
  refuses(start + " --set",
          {{2, "support.r.on=lleft", {"'r'", "'lleft'", "label:NAME"}},
           {2, "support.r.on=left --set support.r.hold=loose", {"hold = loose", "fixed, sliding"}},
           {2, "support.r.on=left --set support.r.move=1,2", {"2 numbers", "x,y,z in mm"}},
           {4, "support.r.on=500,0,0,3", {"meets no node", "from the ball's middle", "a larger ball"}},
           {4, "support.r.on=superior", {"nodes of the contact patch", "--indent-at"}},
           {4, "support.r.on=inferior", {"no node but the base's", "--base-depth"}}});
  refused(4,
          "poke block.nrrd --socket s -q --base inferior --indent-at 0,0,top --nodes 600 --set "
          "support.r.on=superior",
          {"nodes of the contact patch"});
}

}  // namespace
}  // namespace dimple
