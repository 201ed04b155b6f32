// Refusals of the program: the exit code, and the words that state the remedy.

#include <unistd.h>

#include "io/label_image.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

class Refusal : public InFolder {
 protected:
  void SetUp() override { good("phantom brain.nrrd --spacing 3 -q"); }

  /// Expects all four parts of a message on stderr with these words and nothing on stdout. No result is left
  /// behind, at most a summary of the failure.
  void expect(int code, const std::string& arguments, const std::vector<std::string>& words) const {
    SCOPED_TRACE("dimple " + arguments);
    const Ran ran = dimple(folder, arguments);
    EXPECT_EQ(ran.out, "");
    expect_refusal(ran, code, words);
    const fs::path out = folder / "out";
    if (code == 3 || code == 4) {
      if (!fs::exists(out)) return;  // a command without a folder
      const auto summary = nlohmann::json::parse(text_of(out / "summary.json"));
      EXPECT_EQ(summary.at("status"), "failed");
      EXPECT_EQ(summary.at("exit_code"), code);
      for (const char* part : {"code", "fact", "where", "why", "remedy"})
        EXPECT_THAT(ran.err, HasSubstr(summary.at("failure").at(part).get<std::string>())) << part;
      EXPECT_EQ(std::distance(fs::directory_iterator(out), fs::directory_iterator()), 1);
      fs::remove_all(out);
    } else {
      EXPECT_FALSE(fs::exists(out / "summary.json"));
    }
  }
  void run(int code, const std::string& options, const std::vector<std::string>& words) const {
    expect(code, "run brain.nrrd -o out " + options, words);
  }
};

std::string nrrd(const std::string& sizes, const std::string& directions, const std::string& space,
                 const std::string& origin, std::size_t dimension, const std::string& voxels) {
  return "NRRD0004\ntype: uint8\ndimension: " + std::to_string(dimension) + "\n" + space + "sizes: " + sizes +
         "\n" + directions + origin + "encoding: raw\n\n" + voxels;
}

// ---------------------------------------------------------------------------------------------- 3: input

TEST_F(Refusal, OfAPathWhereNothingIs) {
  expect(3, "run nowhere/brain.nrrd -o out", {"nowhere/brain.nrrd", "No such file"});
  expect(3, "info nowhere.nrrd", {"nowhere.nrrd"});
  expect(3, "solve nomodel -o out", {"nomodel", "dimple model"});
}

// The image is the label image of 20 x 20 x 20 voxels of 2 mm, moved to the left.
TEST_F(Refusal, OfAnImageToBeWarpedThatLiesMostlyOutsideTheBodyAndAWarningWhereItIsMoved) {
  good("phantom body.nrrd --shape block --size 30,30,30 --spacing 2");
  const std::string labels = text_of(folder / "body.nrrd");
  const std::string origin = "space origin: (";
  const std::size_t at = labels.find(origin) + origin.size();
  const double x = std::stod(labels.substr(at));
  const auto run_with = [&](double moved) {
    write("mri.nrrd", labels.substr(0, at) + std::to_string(x + moved) + labels.substr(labels.find(',', at)));
    return dimple(folder,
                  "run body.nrrd -o out --force --nodes 300 --depth 0.5mm --band off --warp mri.nrrd");
  };
  EXPECT_THAT(run_with(0.0).err, Not(HasSubstr("mri.nrrd has")));
  for (const auto& [moved, words] :
       {std::pair(1.0, "mri.nrrd has as many voxels as the label image, 1 mm away from it"),
        std::pair(10.0, "of the body at rest outside"),
        std::pair(28.0, "of the body is outside of mri.nrrd")}) {
    const Ran ran = run_with(moved);
    EXPECT_EQ(ran.code, moved > 20.0 ? 3 : 0);
    EXPECT_THAT(ran.err, HasSubstr(words));
  }
}

TEST_F(Refusal, OfAnImageThatCannotBeWarped) {
  write("text.nii.gz", "no image");
  write("notes.txt", "no image");
  write("elsewhere.nrrd",
        nrrd("3 3 3", "space directions: (1,0,0) (0,1,0) (0,0,1)\n", "space: left-posterior-superior\n",
             "space origin: (900,0,0)\n", 3, std::string(27, 'x')));
  write("series.nrrd", nrrd("3 3 3 2", "", "", "", 4, std::string(54, 'x')));
  write("other/elsewhere.nrrd", "");
  run(3, "--warp nowhere.nii.gz", {"nowhere.nii.gz", "No such file", "--warp"});
  run(3, "--warp text.nii.gz", {"text.nii.gz", "--warp", "saved again as .nii.gz"});
  run(3, "--warp-labels notes.txt", {"notes.txt", "known suffix", "--warp-labels"});
  run(3, "--warp series.nrrd", {"4 axes", "three-dimensional"});
  run(3, "--warp elsewhere.nrrd --nodes 400",
      {"elsewhere.nrrd does not overlap the body", "(900, 0, 0)", "same patient"});
  run(2, "--warp elsewhere.nrrd,other/elsewhere.nrrd", {"two images", "called elsewhere"});
  run(2, "--write-frames all", {"no images", "--write-frames", "--warp IMAGE"});
  run(2, "--write-frames some", {"output.write_frames = some", "last, all"});
}

TEST_F(Refusal, OfALabelThatNoVoxelHas) {
  run(3, "--label 7", {"no voxel has label 7", "1 (left_hemisphere)", "2 (right_hemisphere)", "--label"});
  run(3, "--label left_hemisfere",
      {"no label is called 'left_hemisfere'", "did you mean 'left_hemisphere'?", "dimple info"});
}

TEST_F(Refusal, OfADamagedModel) {
  good("model brain.nrrd -o model --nodes 400 -q");
  const auto copy = [&](const char* name) {
    fs::copy(folder / "model", folder / name, fs::copy_options::recursive);
    return folder / name;
  };
  std::ofstream(copy("torn") / "model.toml") << "format = \"dimple model 1\"\nnodes = \"nodes.v";
  expect(3, "solve torn -o out", {"model.toml", "not valid TOML", "line 2"});

  std::ofstream(copy("other") / "model.toml") << "format = \"something else\"\n";
  expect(3, "solve other -o out", {"model.toml", "dimple model 1"});

  fs::remove(copy("without_nodes") / "nodes.vtu");
  expect(3, "solve without_nodes -o out", {"nodes.vtu"});

  fs::resize_file(copy("cut") / "points.vtu", 900);
  expect(3, "solve cut -o out", {"points.vtu"});

  // Names of earlier versions are refused; otherwise another array would be used silently.
  const fs::path before = copy("before") / "nodes.vtu";
  PointFile nodes = read_vtu(before);
  for (Field& field : nodes.fields)
    if (field.name == "spacing_mm") field.name = "spacing";
  write_vtu(before, nodes, 0.0, true);
  expect(3, "solve before -o out", {"nodes.vtu", "'spacing' has no unit", "spacing_mm", "dimple model"});

  const fs::path unlisted = copy("unlisted") / "model.toml";
  std::string text = text_of(unlisted);
  text.erase(text.find("points = "), text.find('\n', text.find("points = ")) - text.find("points = "));
  std::ofstream(unlisted) << text;
  expect(3, "solve unlisted -o out", {"does not name the file of the points"});
}

TEST_F(Refusal, OfAModelWhoseNumbersNoBodyCanHave) {
  std::string nodes = "x_mm,y_mm,z_mm,spacing_mm,node_set\n", points = "x_mm,y_mm,z_mm,volume_mm3\n";
  for (const char* at : {"0,0,0", "4,0,0", "0,4,0", "0,0,4"}) {
    nodes += std::string(at) + (at[4] == '4' ? ",4,2\n" : ",4,1\n");
    points += std::string(at) + ",64\n";
  }
  const std::string model =
      "format = \"dimple model 1\"\nnodes = \"nodes.csv\"\npoints = \"points.csv\"\n"
      "axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
      "[indenter]\ncentre_mm = [0, 0, 4]\npush = [0, 0, -1]\ndiameter_mm = 4\n[support]\ninterpolation = 0\n";
  const auto expect_without = [&](std::string text, const std::string& what, const std::string& instead,
                                  const char* name, const std::vector<std::string>& words) {
    SCOPED_TRACE(instead);
    write("nodes.csv", nodes);
    write("points.csv", points);
    write("model.toml", model);
    text.replace(text.find(what), what.size(), instead);
    write(name, text);
    expect(3, "solve model.toml -o out", words);
  };
  expect_without(nodes, "0,4,0", "0,1e300,0", "nodes.csv", {"nodes.csv", "1e+300", "kilometre"});
  expect_without(nodes, "4,1", "nan,1", "nodes.csv", {"nodes.csv", "line 2", "not a finite number"});
  expect_without(nodes, "4,1", "-4,1", "nodes.csv", {"nodes.csv", "spacing is -4, not positive"});
  expect_without(nodes, "4,1", "4,1e300", "nodes.csv", {"nodes.csv", "node_set is 1e+300", "from 0 to 3"});
  expect_without(points, "4,0,0,64", "4,0,0,0", "points.csv", {"points.csv", "volume is 0, not positive"});
  expect_without(model, "[1, 0, 0]", "[nan, 0, 0]", "model.toml", {"three unit vectors"});
  expect_without(model, "-1]", "0]", "model.toml", {"push is zero"});
  expect_without(model, "diameter_mm = 4", "diameter_mm = -4", "model.toml", {"diameter_mm is -4"});
  expect_without(model, "interpolation = 0", "interpolation = nan", "model.toml", {"interpolation is nan"});

  expect_without(nodes, nodes, "x_mm,y_mm,z_mm\n", "nodes.csv", {"nodes.csv", "list is empty"});
  const std::string same = "x_mm,y_mm,z_mm\n1,2,3\n1,2,3\n1,2,3\n";
  expect_without(nodes, nodes, same, "nodes.csv", {"nodes.csv", "nodes 0 and 1 are both at"});
  expect_without(points, points, same, "points.csv", {"points.csv", "are at one place"});
}

// One pair of each kind is refused in the table's words, and nothing is left behind. All: pairs_test.cpp.
TEST_F(Refusal, OfAPairOfFeaturesSaysBothAndWhatToLeaveOut) {
  for (const auto& [options, words] : std::vector<std::pair<std::string, std::string>>{
           {"--friction 0.3", "and the tool is the bonded indenter"},
           {"--tool sphere:5mm --time explicit", "inertia cannot be combined with the tool"},
           {"--tool sphere:5mm --accuracy 5%", "cannot be combined with the tool"},
           {"--scheme horton2007 --preset miller_chinzei_2002", "one neo-Hookean tissue only"},
           {"--wall around:1mm --time explicit", "has no walls"},
           {"--membrane 0.1mm:400kPa --scheme horton2007", "has no membranes"},
           {"--set step.a.move=2 --accuracy 5%", "an accuracy goal cannot be combined with a scene of steps"},
           {"--mu 210Pa+-30% --gravity inferior", "loads other than the tool do not grow with mu"},
           {"--set step.a.move=2 --explain", "has no steps"},
           {"--set load.fluid_lost=superior,50% --gravity inferior", "combined with gravity"}})
    run(2, options, {words});
}

// ---------------------------------------------------------------------------------------------- 2: usage

TEST_F(Refusal, OfAMaterialThatCannotBe) {
  run(2, "--density -1000", {"material.density_kg_per_m3 = -1000", "--density", "above 0"});
  run(2, "--nu 0.5", {"material.nu = 0.5", "--nu", "0.49999"});
  run(2, "--mu 0", {"material.mu_Pa = 0", "above 0"});
  run(2, "--mu nan", {"material.mu_Pa = nan", "not a finite number"});
  run(2, "--set material.prony_g=half",
      {"material.prony_g = half is not allowed", "it is not a number", "numbers, separated by commas"});
  write("nested.toml", "[material]\nprony_g = [[0.5]]\n");
  run(2, "--config nested.toml", {"nested.toml, line 2", "give numbers, separated by commas"});
  run(2, "--set material.prony_g=0.5", {"1 relaxing parts and 0 relaxation times"});
  run(2, "--set material.prony_g=0.6,0.4 --set material.prony_tau_s=1,2", {"nothing would be left"});
  run(2, "--set material.ogden_mu_Pa=100,200 --set material.ogden_alpha=2",
      {"2 Ogden moduli and 1 exponents"});
  run(2, "--set material.ogden_mu_Pa=-5 --set material.ogden_alpha=2", {"add up to -5"});
  run(2, "--set material.mooney_c01=106Pa", {"c01 is 106 Pa, more than mu/2, 105"});
  run(2, "--set material.mooney_c01=50Pa --set material.ogden_mu_Pa=100 --set material.ogden_alpha=2",
      {"numbers of two laws"});
  run(2, "--preset nobody_1999", {"nobody_1999", "miller_chinzei_2002"});
  run(2, "--scheme horton2007 --stress printed --set material.mooney_c01=50Pa",
      {"the printed stress is of a neo-Hookean tissue", "Mooney-Rivlin"});
  run(2, "--mu 200Pa --young 600Pa",
      {"shear modulus, 200 Pa, and Young's modulus, 600 Pa", "--mu and --young"});
  run(2, "--mu 210Pa --young 600Pa", {"both a shear modulus"});
  run(2, "--set material.E=600", {"did you mean 'material.young'?"});
  run(2, "--young 600mm", {"material.young_Pa = 600mm", "kPa"});
}

TEST_F(Refusal, OfATissueThatIsNotThere) {
  run(3, "--set tissue.7.mu=900", {"no part of the body has label '7'", "no such label"});
  run(3, "--label 1 --set tissue.2.mu=900", {"label '2'", "--label excludes it"});
  run(2, "--set tissue.2.colour=900", {"no option 'material.colour'"});
}

// A wrong reason would mislead the reader.
TEST_F(Refusal, NamesTheFactAndTheReasonThatHold) {
  run(2, "--nodes 400 --gravity=0,0,-1e6", {"gravity '0,0,-1e6' is out of range", "100000 m/s2"});
  run(2, "--nodes 400 --set wall.w.shape=plane:0,0,-90,0,0,1 --set wall.w.friction=-1",
      {"wall.w.friction = -1 is not allowed"});
  run(2, "--nodes 400 --set step.slit.toughnes=100", {"did you mean 'step.slit.toughness"});
  run(2, "--nodes 400 --depth 1e-9mm", {"load.depth_mm = 1e-9mm", "out of range"});
  run(3, "--nodes 400 --label hemisphere", {"did you mean 'left_hemisphere' or 'right_hemisphere'?"});
  run(4, "--nodes 400 --direction 0,0,1 --base inferior",
      {"the contact patch overlaps the fixed base", "direction may have the wrong sign"});
  fs::create_directories(folder / "series");
  expect(3, "run series -o out", {"'series' is a folder", "3D Slicer"});
  expect(2, "view out", {"there is no command 'view'", "report.html or overview.png"});
  for (const std::string flag : {"--wall", "--membrane"}) {
    expect(2, "poke brain.nrrd --socket s " + flag + " x", {"no option " + flag, "`dimple run` has " + flag});
    EXPECT_THAT(dimple(folder, "poke brain.nrrd --socket s " + flag + " x").err, Not(HasSubstr("--set")));
  }
}

TEST_F(Refusal, OfABodyInMetresNamesTheUnit) {
  good("phantom metres.nrrd --shape block --size 0.06,0.06,0.03 --spacing 0.003 -q");
  expect(4, "run metres.nrrd -o out --nodes 400",
         {"no place on the superior side", "may be in metres", "unit"});
}

TEST_F(Refusal, OfAListedNodeThatIsHeldAndMovedNamesIt) {
  write("list/model.toml",
        "format = \"dimple model 1\"\nnodes = \"nodes.csv\"\npoints = \"points.csv\"\n"
        "axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n[indenter]\ncentre_mm = [0, 0, 10]\n"
        "push = [0, 0, -1]\ndiameter_mm = 10\n");
  write("list/points.csv", "x_mm,y_mm,z_mm\n0,0,2\n4,0,2\n0,4,2\n4,4,8\n0,0,8\n4,0,8\n0,4,8\n");
  write("list/nodes.csv",
        "x_mm,y_mm,z_mm,node_set\n0,0,0,1\n5,0,0,1\n0,5,0,1\n5,5,0,1\n0,0,10,2\n5,0,10,2\n0,5,10,2\n"
        "5,5,10,3\n");
  expect(3, "solve list -o out --depth 1mm", {"node 7 at", "belongs to the base and to the contact patch"});
}

TEST_F(Refusal, OfWordsItDoesNotKnow) {
  expect(2, "runn brain.nrrd -o out", {"no command 'runn'", "did you mean 'run'?"});
  run(2, "--nodez 500", {"no option --nodez", "did you mean '--nodes'?"});
  run(2, "--scheme convergin", {"scheme.name = convergin", "did you mean 'converging'?"});
  run(2, "--set material.mew=300Pa",
      {"no option 'material.mew'", "did you mean 'material.mu", "dimple options"});
  run(2, "--set material.mu", {"'material.mu' is not key=value"});
  run(2, "--set mu=300", {"no option 'mu'", "did you mean 'material.mu'?"});
  expect(2, "run brain.nrrd", {"--out"});
  for (const std::string flag :
       {"--depth 3", "--rate 3", "--time explicit", "--damping 3", "--frames 3", "--safety 0.5"})
    expect(2, "poke brain.nrrd " + flag, {flag.substr(0, flag.find(' '))});  // there is no load
}

TEST_F(Refusal, OfPhysicsThatIsNotModelledSaysWhatIs) {
  const std::pair<const char*, std::vector<std::string>> requested[] = {
      {"--body-force 9.81", {"no flag of its own", "--gravity inferior"}},
      {"--load 0.2N", {"a force cannot be prescribed", "--depth 2mm", "force.csv"}},
      {"--unload",
       {"steps of a scene hold and lift a tool", "step.lift.move=-2mm", "dimple poke IMAGE --script"}},
      {"--adhesion 3kPa", {"adhesion is not modelled", "--friction stick"}},
      {"--stress-at 0,0,0", {"results at named points", "--quantity displacement@x,y,z"}},
      {"--friction-coefficient=0.3",
       {"only `dimple run` and `dimple fit` have friction, under a contacting tool", "--friction 0.3"}},
      {"--tear", {"tearing is not modelled", "closest: dimple run IMAGE --cut"}},
      {"--pia 0.1mm", {"bending shells are not modelled", "--membrane 0.1mm:400kPa"}}};
  for (auto [words, texts] : requested) {
    texts.insert(texts.end(), {"the model covers quasi-static and dynamic indentation", "not-modelled"});
    run(2, words, texts);
  }
  expect(2, "model brain.nrrd -o out --tool sphere:5mm",
         {"only `dimple run`, `fit`, `places` and `poke` have a tool of another shape", "not-modelled"});
  run(2, "--gravity", {"--gravity has no value", "usage of the command"});
  // The missing --out is reported, not the valid option.
  expect(2, "run brain.nrrd --tool sphere:5mm", {"--out", "usage of the command"});
}

TEST_F(Refusal, OfFilesThatNoRunWrites) {
  run(2, "--write nodes,pictur",
      {"output.write = nodes,pictur", "'pictur' is not one of the words allowed", "did you mean 'picture'?",
       "give some of all, force, nodes"});
  run(2, "--write ,", {"output.write = ,", "the list is empty"});
  write("none.toml", "[output]\nwrite = []\n");
  run(2, "--config none.toml", {"output.write = nothing", "the list is empty"});
  expect(2, "model brain.nrrd -o out --write nodes",
         {"`dimple model` has no option --write", "--set output.write=VALUE"});
}

TEST_F(Refusal, OfGapsThatCannotBeClosedAndOfUnitsThatMeasureSomethingElse) {
  run(2, "--close -1mm", {"image.close_mm = -1mm", "out of range"});
  run(2, "--close wide", {"image.close_mm = wide", "not a number"});
  run(2, "--close 4Pa", {"image.close_mm = 4Pa", "'Pa' is not one of its units"});
  run(4, "--close 200mm",
      {"gaps of up to 200 mm are to be closed in an organ", "--close (image.close_mm)", "close-too-wide"});
  run(2, "--depth 3kPa", {"load.depth_mm = 3kPa", "'kPa' is not one of its units", "mm"});
  run(2, "--set material.mu=3psi", {"material.mu_Pa = 3psi", "'psi'", "kPa"});
  run(2, "--nodes 3mm", {"cloud.nodes = 3mm", "no unit"});
}

TEST_F(Refusal, OfAConfigurationWithAMistakeInIt) {
  write("torn.toml", "[material]\nmu = \n");
  run(2, "--config torn.toml", {"torn.toml", "not valid TOML", "line 2"});
  write("unknown.toml", "[material]\nstiffness = 300\n");
  run(2, "--config unknown.toml", {"'material.stiffness'", "unknown.toml, line 2"});
  write("typed.toml", "[material]\nnu = true\n");
  run(2, "--config typed.toml", {"material.nu = true", "must be a number"});
}

TEST_F(Refusal, OfOneOptionWithTwoValues) {
  run(2, "--depth 1mm --depth 2mm", {"--depth is given 2 times", "leave all but one"});
  const std::string twice = " is given twice";
  run(2, "--set load.depth=1 --set load.depth_mm=2",
      {"load.depth_mm" + twice + ": load.depth = 1, and load.depth_mm = 2"});
  run(2, "--set material.mu=300 --mu 200", {"material.mu_Pa" + twice, "--set; --mu"});
  const auto refuses = [&](const std::string& toml, const std::string& word) {
    write("two.toml", toml);
    run(2, "--nodes 400 --config two.toml", {word});
  };
  refuses("[material]\nmu = 100\nmu_Pa = 2\n", "material.mu_Pa" + twice);
  refuses("[step.a]\nmove=1\nmove_mm=0.5\n", "step.a.move_mm" + twice);
  refuses("[tissue.2]\nmu=300\nmu_Pa=100\n", "tissue.2.mu_Pa" + twice);
  refuses("[tissue.1]\nmu=300\n[tissue.left_hemisphere]\nmu=100\n", "label 1 is given two tissues");
  refuses("[step.press]\n# move = 2\n", "the section [step.press] is empty");
  write("same.toml", "[material]\nmu = 100\nmu_Pa = 100\n");  // no contradiction
  good("model brain.nrrd -o same --nodes 400 -q --config same.toml");
}

// ---------------------------------------------------------------------------------------------- 4: model

TEST_F(Refusal, OfAToolThatMissesTheOrganPassesItOrHangsOverItsEdge) {
  run(4, "--indent-at 500,0,0 -q", {"misses the organ", "--indent-at"});
  run(4, "--nodes 500 --depth 40mm -q", {"40", "deeper than the organ", "--depth"});
  run(4, "--indent-at 0,45,5 -q", {"extends beyond", "--indenter-diameter"});
  run(4, "--tool punch:60mm,edge=6mm --indent-at 0,0,top -q",
      {"over an edge", "not modelled", "--tool sphere:1000mm"});
}

// An image has no information on a surface finer than its voxels, for any command.
TEST_F(Refusal, OfAPatchThatIsSmallerThanAVoxel) {
  write("path.csv", "time_s,depth_mm\n0,0\n0.1,1\n");
  const std::vector<std::string> words = {"2 mm diameter is smaller than a voxel of 3 mm",
                                          "--indenter-diameter", "give at least 9 mm", "circle-too-small"};
  for (const std::string command :
       {"run brain.nrrd -o out", "model brain.nrrd -o out", "run brain.nrrd -o out --accuracy 5% --depth 1mm",
        "export brain.nrrd -o mesh.inp", "poke brain.nrrd --script path.csv",
        "fit brain.nrrd -o out --curve curve.csv"}) {
    write("curve.csv", "indentation_mm,force_N\n1,0.01\n2,0.02\n");
    expect(4, command + " --indenter-diameter 2", words);
  }
  for (const std::string command : {"run brain.nrrd -o few --nodes 400 --depth 0.5mm --frames 1",
                                    "export brain.nrrd -o few.inp --nodes 3000",
                                    "poke brain.nrrd --script path.csv --evaluations 4 --nodes 400"}) {
    SCOPED_TRACE(command);
    const Ran ran = good(command + " --indenter-diameter 5");
    EXPECT_THAT(ran.err, HasSubstr("1.7 voxels across: the image barely resolves the surface beneath it"));
  }
  const Ran wide = dimple(folder, "run brain.nrrd -o wide --nodes 400 --depth 0.5mm --frames 1");
  EXPECT_THAT(wide.err, Not(HasSubstr("voxels across")));
}

// The body is two layers of voxels, or one, or a speck, in an image of its own.
TEST_F(Refusal, OfABodyThatIsNoneOrTooThin) {
  const auto plate = [&](const char* name, Index layers, Index width) {
    const auto within = [](Index at, Index count) { return at >= 5 && at < 5 + count; };
    const auto label = [&](Index i, Index j, Index k) {
      return within(i, width) && within(j, width) && within(k, layers);
    };
    write_label_image(folder / name, image_of({60, 60, 12}, Vec3::Ones(), label));
  };
  plate("sheet.nrrd", 1, 50);
  plate("plate.nrrd", 2, 50);
  plate("speck.nrrd", 3, 3);
  expect(4, "run sheet.nrrd -o out --nodes 400",
         {"smoothing its surface would lose", "three voxels thick", "too-thin"});
  expect(4, "run plate.nrrd -o out --nodes 400",
         {"node spacings thick under the contact patch", "code:  thin"});
  expect(4, "run speck.nrrd -o out --nodes 400", {"27 voxels", "at least 64"});
}

// Each row requests an impossible model: the options, the exit code, a word of the reason.
TEST_F(Refusal, OfPlacesAndNumbersThatNoModelCanHave) {
  struct Row {
    int code;
    const char *options, *word;
  };
  for (const Row& row : {
           Row{2, "--gravity down", "give superior, inferior, anterior"},
           Row{2, "--direction 0,0,0", "is not a direction"},
           Row{2, "--nodes 20", "cloud.nodes = 20"},
           Row{4, "--nodes 400 --indent-at 0,0,90", "code:  place-moved"},
           Row{4, "--indenter-diameter 70", "has room for a tool of 70.0 mm"},
           Row{4, "--nodes 400 --base superior --indent-at 0,0,30 --direction 0,0,-1",
               "overlaps the fixed base"},
           Row{4, "--nodes 400 --points 4", "integration cells meet the body"},
           Row{4, "--nodes 1000 --points 60 --scheme horton2007", "in no support domain"},
           Row{4, "--nodes 400 --support 0.5", "code:  supports"},
           Row{4, "--nodes 400 --rim 0.001", "needs more nodes than requested"},
           Row{4, "--spacing 0.2", "at most 1000000 are possible"},
           Row{2, "--nodes 400 --spacing 5", "both 400 nodes and a spacing of 5.00 mm are given"},
           Row{2, "--points 4000 --set grid.ratio=5",
               "both 4000 integration points and 5 of them per node are given"},
           Row{2, "--set tissue.1.prony_g=0.6,0.5 --set tissue.1.prony_tau_s=1,2", "where: [tissue.1]"},
       }) {
    run(row.code, row.options, {row.word});
  }
}

TEST_F(Refusal, IsNotOfANumberOfNodesInAdditionToAFilesSpacing) {
  std::ofstream(folder / "even.toml") << "[cloud]\nspacing_mm = 5\n";
  const Ran ran = good("model brain.nrrd -o model --config even.toml --nodes 400");
  EXPECT_THAT(ran.err, HasSubstr("400 nodes"));
}

// --------------------------------------------------------------------------------------------- 6: output

TEST_F(Refusal, OfAFolderThatHoldsOtherPeoplesFiles) {
  write("out/thesis.tex", "years of work");
  run(6, "--nodes 400 -q", {"out", "not results of dimple", "-o"});
  EXPECT_EQ(text_of(folder / "out" / "thesis.tex"), "years of work");
}

TEST_F(Refusal, OfAFolderThatMayNotBeWrittenTo) {
  if (geteuid() == 0) GTEST_SKIP() << "skipped: running as root, who may write everywhere";
  fs::create_directories(folder / "locked");
  fs::permissions(folder / "locked", fs::perms::owner_read | fs::perms::owner_exec);
  expect(6, "run brain.nrrd -o locked/out --nodes 400 -q", {"locked/out", "Permission denied"});
  expect(6, "run brain.nrrd -o locked --nodes 400 -q", {"locked"});
  fs::permissions(folder / "locked", fs::perms::owner_all);
}

// ------------------------------------------------------------------------------------------ nothing behind

TEST_F(Refusal, LeavesOneWordOfItAndTheCorrectedCommandJustWorks) {
  const std::string coarse = " --nodes 400 --frames 1 -q";
  const auto refused_then_good = [&](int code, const std::string& wrong, const std::string& right) {
    SCOPED_TRACE(wrong);
    fs::remove_all(folder / "kept");
    const Ran ran = dimple(folder, wrong + " -o kept" + coarse);
    EXPECT_EQ(ran.code, code) << ran.err;
    std::vector<std::string> left;
    if (fs::exists(folder / "kept"))
      for (const auto& entry : fs::directory_iterator(folder / "kept"))
        left.push_back(entry.path().filename());
    EXPECT_EQ(left, code == 2 ? std::vector<std::string>{} : std::vector<std::string>{"summary.json"});
    EXPECT_EQ(fs::exists(folder / "kept"), code != 2);
    good(right + " -o kept" + coarse);
  };
  const std::string shallow = "run brain.nrrd --depth 1mm";
  refused_then_good(4, "run brain.nrrd --depth 500mm", shallow);
  EXPECT_EQ(summary("kept").at("status"), "finished");
  refused_then_good(4, shallow + " --indent-at 500,0,0", shallow);
  refused_then_good(3, shallow + " --label 7", shallow + " --label 2");
  refused_then_good(3, "run nowhere.nrrd", shallow);
  refused_then_good(2, shallow + " --nu 0.7", shallow);
  EXPECT_EQ(dimple(folder, "model brain.nrrd -o made" + coarse).code, 2) << "--frames is no option of it";
  EXPECT_FALSE(fs::exists(folder / "made"));
  EXPECT_EQ(dimple(folder, "model brain.nrrd -o made --nodes 400 --indent-at 500,0,0 -q").code, 4);
  good("model brain.nrrd -o made --nodes 400 -q");
  EXPECT_FALSE(fs::exists(folder / "made" / "summary.json"));
  fs::remove_all(folder / "kept");
  EXPECT_EQ(dimple(folder, "solve made -o kept --depth 500mm -q").code, 4);
  good("solve made -o kept --depth 1mm --frames 1 -q");
}

TEST_F(Refusal, LeavesResultsThatAreThereAlone) {
  good("run brain.nrrd -o kept --nodes 400 --depth 1mm --frames 1 -q");
  const std::string before = text_of(folder / "kept" / "summary.json");
  EXPECT_EQ(dimple(folder, "run nowhere.nrrd -o kept --force -q").code, 3);
  EXPECT_EQ(dimple(folder, "run brain.nrrd -o kept --force --depth 500mm --nodes 400 -q").code, 4);
  EXPECT_EQ(text_of(folder / "kept" / "summary.json"), before);
  EXPECT_TRUE(fs::exists(folder / "kept" / "force.csv"));
}

// ------------------------------------------------------------------------------------- for other programs

TEST_F(Refusal, IsValidJsonForThoseWhoAskForIt) {
  const Ran ran = dimple(folder, "run brain.nrrd -o out --label 7 --json");
  EXPECT_EQ(ran.code, 3);
  const auto json = nlohmann::json::parse(ran.out);
  EXPECT_EQ(json.at("status"), "failed");
  EXPECT_EQ(json.at("exit_code"), 3);
  for (const char* part : {"code", "fact", "where", "why", "remedy"})
    EXPECT_FALSE(json.at("failure").at(part).get<std::string>().empty()) << part;
}

}  // namespace
}  // namespace dimple
