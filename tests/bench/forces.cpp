#include <fmt/format.h>

#include <chrono>
#include <utility>

#include "solver/solve.hpp"
#include "tests/bench/bench.hpp"
#include "tests/bench/reference_force.hpp"
#include "tests/bench/scene.hpp"

namespace dimple {
namespace {

/// Least work of one force evaluation [bytes, flops], counted from the model. It is the same for every
/// implementation, so rates are comparable. Lists are read once for each sum over them; nodal and patch
/// values are assumed to stay in cache. r bytes a number, 4 an index:
///
///     bytes = pairs 2 (3 r + 4) + shares 4 (r + 4) + variance (r + 4) + points 42 r + nodes 6 r
///     flops = pairs 2 x 18      + shares 4 x 2     + variance 6       + points 160
///
/// Pairs: F from u, then f from P. Shares: J_b from J, J~ from J_b, and the transposed sums for their forces.
/// Points: F and V P written and read (36), J - 1 written and read (2), pressure too (2), volume and the term
/// of J - J~ (2); operations: det 29, pressures 10, J^(-2/3) 35, the rest of P 86. Without patches, as in the
/// paper's scheme: 38 r.
struct Work {
  double bytes, flops;
};
Work work_of(const Model& model, double r) {
  const auto pairs = static_cast<double>(model.support.member.size()),
             points = static_cast<double>(model.point_count()),
             nodes = static_cast<double>(model.node_count());
  Work work = {pairs * 2.0 * (3.0 * r + 4.0) + points * 38.0 * r + nodes * 6.0 * r,
               pairs * 36.0 + points * 150.0};
  if (model.patches.count() == 0) return work;
  const auto fractions = static_cast<double>(model.patches.psi.size());
  work.bytes += fractions * 4.0 * (r + 4.0) + points * 4.0 * r;
  work.flops += fractions * 8.0 + points * 10.0;
  for (const GradientVariance& v : model.variance) {
    work.bytes += static_cast<double>(v.K.size()) * (r + 4.0);
    work.flops += static_cast<double>(v.K.size()) * 6.0;
  }
  return work;
}

void count(benchmark::State& state, const Work& work) {
  using benchmark::Counter;
  state.counters["bytes_per_second"] = Counter(work.bytes, Counter::kIsIterationInvariantRate);
  state.counters["FLOPS"] = Counter(work.flops, Counter::kIsIterationInvariantRate);
}

void product(benchmark::State& state, const std::string& scheme, Index nodes, Precision precision,
             int threads) {
  const MeasuredBlock& s = scene(scheme, nodes);
  const Threads limit(threads);
  const ForceSystem system(s.model, s.material, precision);
  ForceState forces(system);
  ForceSystem::Nodal f = s.u;
  for (auto _ : state) {
    forces.internal_force(s.u, f);
    benchmark::DoNotOptimize(f.data());
  }
  count(state, work_of(s.model, precision == Precision::single_ ? 4.0 : 8.0));
}

template <class Real>
void reference(benchmark::State& state, Index nodes) {
  const MeasuredBlock& s = scene("converging", nodes);
  ReferenceForce<Real> plain(s.model, s.material);
  set_displacement(plain, s.u);
  for (auto _ : state) {
    evaluate(plain);
    benchmark::DoNotOptimize(plain.f_x.data());
  }
  count(state, work_of(s.model, sizeof(Real)));
}

/// Equilibrium at a sixteenth of the whole depth, from rest.
void quasi_static_depth(benchmark::State& state, int threads) {
  const MeasuredBlock& s = scene("converging", 4250);
  const Threads limit(threads);
  const ForceSystem system(s.model, s.material, Precision::single_);
  ForceState forces(system);
  SolverOptions options = solver_options(s.run);
  Loading loading = loading_of(s.run);
  loading.depth /= options.frames;
  options.frames = 1;
  double evaluations = 0.0;
  for (auto _ : state) {
    History history;
    solve(TimeMode::quasi_static, system, s.model, loading, options, {}, history);
    evaluations += static_cast<double>(history.evaluations);
  }
  state.counters["evaluations"] = benchmark::Counter(evaluations, benchmark::Counter::kAvgIterations);
}

/// One of the steps between the first sample of the force and one at least 100 steps later: force, update,
/// and a fraction of the periodic checks. Finding the stable step is excluded.
void dynamic_step(benchmark::State& state, const std::string& scheme, int threads) {
  using Clock = std::chrono::steady_clock;
  const MeasuredBlock& s = scene(scheme, 4250);
  const Threads limit(threads);
  const ForceSystem system(s.model, s.material, Precision::single_);
  ForceState forces(system);
  for (auto _ : state) {
    Clock::time_point start;
    double seconds = 0.0;
    History history;
    Observer observer;
    observer.sample = [&](const ForceSample& now, const History& h) {
      if (now.t == 0.0) start = Clock::now();
      if (seconds > 0.0 || h.evaluations < 100) return seconds == 0.0;
      seconds =
          std::chrono::duration<double>(Clock::now() - start).count() / static_cast<double>(h.evaluations);
      return false;
    };
    solve(TimeMode::explicit_, system, s.model, loading_of(s.run), solver_options(s.run), observer, history);
    state.SetIterationTime(seconds);
  }
}

template <class... Arguments>
benchmark::internal::Benchmark* add(const std::string& name, Arguments&&... arguments) {
  return benchmark::RegisterBenchmark(name.c_str(), std::forward<Arguments>(arguments)...)
      ->UseRealTime()
      ->Unit(benchmark::kMicrosecond);
}

}  // namespace

void register_forces() {
  for (const Index nodes : {2000, 4250, 16000}) {
    add(fmt::format("reference/single/{}/1_thread", nodes), &reference<float>, nodes);
    add(fmt::format("reference/double/{}/1_thread", nodes), &reference<double>, nodes);
    for (const int threads : {1, 2})
      for (const Precision precision : {Precision::single_, Precision::double_}) {
        const char* word = precision == Precision::single_ ? "single" : "double";
        add(fmt::format("force/converging_{}/{}/{}", word, nodes, threads_word(threads)), &product,
            "converging", nodes, precision, threads);
      }
  }
  for (const int threads : {1, 2}) {
    add(fmt::format("force/horton2007_double/4250/{}", threads_word(threads)), &product, "horton2007",
        Index{4250}, Precision::double_, threads);
    add(fmt::format("solve/quasi_static_depth/4250/{}", threads_word(threads)), &quasi_static_depth, threads)
        ->Iterations(1);
    for (const char* scheme : {"converging", "horton2007"})
      benchmark::RegisterBenchmark(
          fmt::format("solve/dynamic_step_{}/4250/{}", scheme, threads_word(threads)).c_str(), &dynamic_step,
          scheme, threads)
          ->UseManualTime()
          ->Iterations(1)
          ->Unit(benchmark::kMicrosecond);
  }
}

}  // namespace dimple
