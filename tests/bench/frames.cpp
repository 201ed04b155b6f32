// Frames are for looking: the same bodies with 1, 4 and 16 of them.
//
//   dimple_frames FOLDER [--bodies 100] [--nodes 1000] [--radii 1.6]
//
// Writes frames.csv, a row for each random body (tests/helpers/random_bodies.hpp) and number of frames, and
// says which forces differ by more than 0.1 % and which marches ended before, why.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <filesystem>
#include <string>

#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/build_model.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/random_bodies.hpp"

namespace dimple {
namespace {

struct Marched {
  History history;
  std::string code;  // of the error that ended it
};

Marched march(const Model& model, const ForceSystem& system, double depth, int frames) {
  Marched marched;
  try {
    solve(TimeMode::quasi_static, system, model, {.depth = depth}, {.frames = frames}, {}, marched.history);
  } catch (const SolveError& error) {
    marched.code = error.report.code;
  }
  return marched;
}

void compare(const std::filesystem::path& folder, int bodies, Index nodes, double radii) {
  std::string csv = "body,extent_mm,diameter_mm,nu,frames,force_N,indentation_mm,retries,evaluations,ended\n";
  int refused = 0, marched = 0, ended = 0, differ = 0;
  for (int number = 1; number <= bodies; ++number) {
    const RandomBody body = random_body(number);
    ModelOptions options;
    options.cloud.count = nodes;
    options.boundary = body.boundary;
    try {
      const Model model = build_model(body.image, {}, options).model;
      const ForceSystem system(model, neo_hookean(210.0, body.nu, 1000.0), Precision::single_);
      std::array<double, 3> force{};
      std::array<std::string, 3> code;
      for (std::size_t k = 0; k < 3; ++k) {
        const int frames = std::array{1, 4, 16}[k];
        const auto [history, why] = march(model, system, radii * model.tool.radius, frames);
        force[k] = history.force.back().force;
        code[k] = why;
        csv += fmt::format("{},{},{:.2f},{:g},{},{:.9g},{:.6g},{},{},{}\n", number, body.name,
                           body.boundary.indenter_diameter_mm, body.nu, frames, force[k],
                           1e3 * history.force.back().depth, history.retries.size(),
                           history.evaluations + history.extra_evaluations, why);
      }
      ++marched;
      ended += !code[0].empty();
      const auto [least, most] = std::minmax_element(force.begin(), force.end());
      if (code[0] != code[1] || code[0] != code[2] || *most - *least > 1e-3 * std::abs(*most)) {
        ++differ;
        fmt::print("{}: {} N with 1, 4 and 16 frames; ended by '{}'\n", number,
                   fmt::format("{:.6g} {:.6g} {:.6g}", force[0], force[1], force[2]), code[0]);
      }
      if (!code[0].empty()) fmt::print("{}: ended by {}\n", number, code[0]);
    } catch (const ModelError& error) {
      ++refused;
      csv += fmt::format("{},{},{:.2f},{:g},,,,,,refused\n", number, body.name,
                         body.boundary.indenter_diameter_mm, body.nu);
      fmt::print("{}: {}\n", number, error.report.fact);
    }
    std::fflush(stdout);
  }
  write_file(folder / "frames.csv", csv);
  fmt::print(
      "{} bodies, {} refused; {} marched, {} of them ended before their depth; {} differ by more than 0.1 "
      "%\n",
      bodies, refused, marched, ended, differ);
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  std::filesystem::path folder;
  int bodies = 100;
  dimple::Index nodes = 1000;
  double radii = 1.6;
  CLI::App app("Forces with 1, 4 and 16 frames");
  app.add_option("folder", folder, "for the table")->required();
  app.add_option("--bodies", bodies, "how many");
  app.add_option("--nodes", nodes, "of each cloud");
  app.add_option("--radii", radii, "depth in radii of the circle");
  CLI11_PARSE(app, argc, argv);
  dimple::make_folder(folder);
  dimple::compare(folder, bodies, nodes, radii);
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
