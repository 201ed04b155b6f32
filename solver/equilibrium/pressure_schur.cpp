#include "solver/equilibrium/pressure_schur.hpp"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/IterativeLinearSolvers>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <thread>

#include "io/stop.hpp"
#include "solver/equilibrium/mixed_constants.hpp"

namespace dimple {
namespace {

// Nodes in the supports of each patch's points, ascending.
std::vector<std::vector<int>> nodes_of_each(const Model& model, const CompressedRows& points) {
  std::vector<std::vector<int>> nodes(static_cast<std::size_t>(points.rows()));
  tbb::enumerable_thread_specific<std::vector<Index>> stamps(
      std::vector<Index>(static_cast<std::size_t>(model.node_count()), -1));
  tbb::parallel_for(tbb::blocked_range<Index>(0, points.rows(), 64), [&](const auto& range) {
    stop_if_requested();
    std::vector<Index>& seen = stamps.local();
    for (Index b = range.begin(); b < range.end(); ++b) {
      std::vector<int>& its = nodes[static_cast<std::size_t>(b)];
      for (int k = points.offset[b]; k < points.offset[b + 1]; ++k) {
        const int q = points.member[k];
        for (int e = model.support.offset[q]; e < model.support.offset[q + 1]; ++e) {
          const int a = model.support.member[e];
          if (seen[static_cast<std::size_t>(a)] == b) continue;
          seen[static_cast<std::size_t>(a)] = b;
          its.push_back(a);
        }
      }
      std::sort(its.begin(), its.end());
    }
  });
  return nodes;
}

// Nodes of each patch in compressed rows.
CompressedRows nodes_of_patches(const Model& model, const CompressedRows& points) {
  const std::vector<std::vector<int>> nodes = nodes_of_each(model, points);
  CompressedRows result;
  result.offset = Eigen::VectorXi::Zero(points.rows() + 1);
  for (Index b = 0; b < points.rows(); ++b)
    result.offset[b + 1] = result.offset[b] + static_cast<int>(nodes[static_cast<std::size_t>(b)].size());
  result.member.resize(result.offset[points.rows()]);
  for (Index b = 0; b < points.rows(); ++b)
    std::copy(nodes[static_cast<std::size_t>(b)].begin(), nodes[static_cast<std::size_t>(b)].end(),
              result.member.data() + result.offset[b]);
  return result;
}

}  // namespace

PressureSchur::PressureSchur(const System& body)
    : body_(body),
      model_(body.model()),
      points_(transpose(model_.patches.of_point, model_.patches.count(), &slot_)),
      nodes_(nodes_of_patches(model_, points_)),
      scale_(model_.patches.count()) {
  const ForceSystem& tissue = body.tissue().system();
  for (Index b = 0; b < scale_.size(); ++b)
    scale_[b] =
        1.0 / std::sqrt(tissue.shear_modulus(points_.member[points_.offset[b]]) * model_.patches.volume[b]);
}

void PressureSchur::find_gradient() {
  body_.tissue().patch_gradients(nodes_, gradient_);
}

Eigen::VectorXd PressureSchur::volume_change(const Nodal& du) const {
  Eigen::VectorXd change(model_.patches.count());
  tbb::parallel_for(tbb::blocked_range<Index>(0, change.size(), 64), [&](const auto& range) {
    for (Index b = range.begin(); b < range.end(); ++b) {
      double sum = 0.0;
      for (int k = nodes_.offset[b]; k < nodes_.offset[b + 1]; ++k)
        sum += gradient_.col(k).cast<double>().dot(du.col(nodes_.member[k]));
      change[b] = sum;
    }
  });
  return change;
}

void PressureSchur::add_forces(const Eigen::VectorXd& lambda, Nodal& f) const {
  for (Index b = 0; b < lambda.size(); ++b)
    for (int k = nodes_.offset[b]; k < nodes_.offset[b + 1]; ++k)
      f.col(nodes_.member[k]) += lambda[b] * gradient_.col(k).cast<double>();
}

// Calls add(b, value), b >= c, for all parts of column c of S.
template <class Add>
void PressureSchur::visit_column(int c, const Add& add) const {
  const PressurePatches& patches = model_.patches;
  const ForceSystem& tissue = body_.tissue().system();
  for (int k = points_.offset[c]; k < points_.offset[c + 1]; ++k) {
    const int q = points_.member[k];
    for (int i = patches.of_point.offset[q]; i < patches.of_point.offset[q + 1]; ++i)
      if (const int b = patches.of_point.member[i]; b >= c)
        add(b, patches.psi[i] * patches.psi[slot_[k]] * model_.volume[q] /
                   (tissue.shear_modulus(q) * patches.volume[b] * patches.volume[c]));
  }
  add(c, 1.0 / (bulk_[c] * patches.volume[c]));
}

// Lower half of S, column by column: there would be hundreds of triplets for each entry.
PressureSchur::Sparse PressureSchur::lower_half() const {
  const int count = static_cast<int>(model_.patches.count());
  Sparse matrix(count, count);
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(count);
  std::vector<char> seen(static_cast<std::size_t>(count), 0);
  std::vector<int> rows;
  for (int c = 0; c < count; ++c) {
    if (c % 256 == 0) stop_if_requested();
    rows.clear();
    visit_column(c, [&](int row, double value) {
      if (!seen[static_cast<std::size_t>(row)]) {
        seen[static_cast<std::size_t>(row)] = 1;
        rows.push_back(row);
      }
      sum[row] += value;
    });
    std::sort(rows.begin(), rows.end());
    matrix.startVec(c);
    for (const int row : rows) {
      matrix.insertBack(row, c) = sum[row];
      sum[row] = 0.0;
      seen[static_cast<std::size_t>(row)] = 0;
    }
  }
  matrix.finalize();
  return matrix;
}

// Null: not positive definite. Eigen's factorisation cannot be stopped: a long one runs in a thread of its
// own, which a stop abandons.
std::shared_ptr<const PressureSchur::Factor> PressureSchur::factorised(Sparse matrix) {
  const auto positive = [](std::shared_ptr<const Factor> factor) {
    return factor->info() == Eigen::Success ? factor : nullptr;
  };
  if (matrix.rows() < mixed_constants.quickly_factorised)
    return positive(std::make_shared<const Factor>(matrix));
  std::packaged_task<std::shared_ptr<const Factor>()> task(
      [matrix = std::move(matrix)] { return std::make_shared<const Factor>(matrix); });
  auto result = task.get_future();
  std::thread(std::move(task)).detach();
  while (result.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready) stop_if_requested();
  return positive(result.get());
}

bool PressureSchur::factorise(const Eigen::VectorXd& bulk) {
  if (bulk_.size() == bulk.size() && bulk_ == bulk) return true;
  bulk_ = bulk;
  Sparse matrix = lower_half();
  factor_ = nullptr;
  matrix_ = Sparse();
  bool positive = false;
  if (matrix.rows() > mixed_constants.worth_factorising) {
    matrix_ = std::move(matrix);
    positive = Eigen::VectorXd(matrix_.diagonal()).minCoeff() > 0.0;
  } else {
    factor_ = factorised(std::move(matrix));
    positive = factor_ != nullptr;
  }
  if (!positive) bulk_.resize(0);
  return positive;
}

Eigen::VectorXd PressureSchur::apply(const Eigen::VectorXd& r) const {
  if (factor_) return factor_->solve(r);
  Eigen::ConjugateGradient<Sparse, Eigen::Lower> iteration(matrix_);
  iteration.setTolerance(mixed_constants.schur_tolerance)
      .setMaxIterations(mixed_constants.most_schur_iterations);
  stop_if_requested();
  return iteration.solve(r);
}

}  // namespace dimple
