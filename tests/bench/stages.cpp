#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>

#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/pressure_patches.hpp"
#include "preprocess/supports/support.hpp"
#include "tests/bench/bench.hpp"
#include "tests/bench/scene.hpp"

namespace dimple {
namespace {

constexpr Index nodes = 4250;

// Results of the stages before the measured one; computed on first use.
struct Before {
  const MeasuredBlock& final = scene("converging", nodes);
  ModelOptions options = model_options(final.run);
  SegmentedBody body = make_body_surface(final.image, {});
  Boundary boundary = find_boundary(body.surface, options.boundary);
  Sizing sizing{body.surface, boundary, options.node_set.grading};
  NodeSet node_set = make_node_set(body.surface, boundary, sizing, options.node_set);
  Model supported = final.model;  // with gradients as find_supports() leaves them
  Before() { find_supports(supported); }
};
const Before& before() {
  static const Before made;
  return made;
}

void read_image(benchmark::State& state) {
  const auto file = std::filesystem::temp_directory_path() / fmt::format("dimple_bench_{}.nrrd", getpid());
  write_label_image(file, before().final.image);
  for (auto _ : state) benchmark::DoNotOptimize(read_label_image(file).size);
  std::filesystem::remove(file);
}

void surface(benchmark::State& state) {
  for (auto _ : state) make_body_surface(before().final.image, {});
}

void boundary_conditions(benchmark::State& state) {
  const Before& b = before();
  for (auto _ : state) benchmark::DoNotOptimize(find_boundary(b.body.surface, b.options.boundary));
}

void node_cloud(benchmark::State& state) {
  const Before& b = before();
  for (auto _ : state)
    benchmark::DoNotOptimize(
        make_node_set(b.body.surface, b.boundary, b.sizing, b.options.node_set).X.data());
}

void grid(benchmark::State& state) {
  const Before& b = before();
  for (auto _ : state)
    benchmark::DoNotOptimize(
        make_graded_grid(b.body.surface, b.options.grid, nodes, b.sizing, b.node_set.far_spacing)
            .point.data());
}

// Runs a stage that changes a model on a fresh copy each time; copying is not measured.
template <class Stage>
void on_copy(benchmark::State& state, const Model& start, const Stage& stage) {
  for (auto _ : state) {
    state.PauseTiming();
    Model model = start;
    state.ResumeTiming();
    stage(model);
  }
}

void supports(benchmark::State& state) {
  const Before& b = before();
  on_copy(state, b.final.model, [&](Model& model) { find_supports(model); });
}

void consistency(benchmark::State& state) {
  const Before& b = before();
  on_copy(state, b.supported, [&](Model& model) {
    make_consistent(model, surface_integrals(model, model.scheme.support, pieces_of(model)));
  });
}

void patches(benchmark::State& state) {
  const Before& b = before();
  on_copy(state, b.supported, [&](Model& model) { make_pressure_patches(model); });
}

void complete_from_image(benchmark::State& state) {
  for (auto _ : state)
    benchmark::DoNotOptimize(whole_model(before().final.image, before().final.run).mass.data());
}

void force_system(benchmark::State& state) {
  const MeasuredBlock& s = before().final;
  for (auto _ : state)
    benchmark::DoNotOptimize(ForceSystem(s.model, s.material, Precision::single_).point_count());
}

}  // namespace

void register_stages() {
  const struct {
    const char* name;
    void (*body)(benchmark::State&);
  } stages[] = {
      {"read_image", &read_image},    {"surface", &surface}, {"boundary_conditions", &boundary_conditions},
      {"node_cloud", &node_cloud},    {"grid", &grid},       {"supports", &supports},
      {"consistency", &consistency},  {"patches", &patches}, {"complete_model", &complete_from_image},
      {"force_system", &force_system}};
  for (const auto& stage : stages)  // with as many threads as the program uses
    benchmark::RegisterBenchmark(fmt::format("stage/{}/{}/all_threads", stage.name, nodes).c_str(),
                                 stage.body)
        ->UseRealTime()
        ->Unit(benchmark::kMicrosecond);
}

}  // namespace dimple
