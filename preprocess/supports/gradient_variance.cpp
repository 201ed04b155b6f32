#include "preprocess/supports/gradient_variance.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <utility>

#include "io/stop.hpp"

namespace dimple {
namespace {

// Nodes of some points, and their indices in the points' lists.
struct Influence {
  std::vector<int> nodes;  // of these points, as they are met
  std::vector<std::size_t> offset = {0};
  std::vector<std::pair<int, int>> place;  // point, place in its list
};

Influence influence_of(const std::vector<PointSupport>& points, std::span<const int> tissue, int requested,
                       std::vector<int>& slot) {
  Influence result;
  auto& [nodes, offset, influence] = result;
  for (std::size_t q = 0; q < points.size(); ++q)
    if (tissue[q] == requested)
      for (const int a : points[q].nodes) {
        int& at = slot[static_cast<std::size_t>(a)];
        if (at < 0) {
          at = static_cast<int>(nodes.size());
          nodes.push_back(a);
          offset.push_back(0);
        }
        ++offset[static_cast<std::size_t>(at) + 1];
      }
  for (std::size_t n = 0; n < nodes.size(); ++n) offset[n + 1] += offset[n];
  influence.resize(offset.back());
  std::vector<std::size_t> next(offset.begin(), offset.end() - 1);
  for (std::size_t q = 0; q < points.size(); ++q)
    if (tissue[q] == requested)
      for (std::size_t k = 0; k < points[q].nodes.size(); ++k) {
        const int at = slot[static_cast<std::size_t>(points[q].nodes[k])];
        influence[next[static_cast<std::size_t>(at)]++] = {static_cast<int>(q), static_cast<int>(k)};
      }
  for (const int a : nodes) slot[static_cast<std::size_t>(a)] = -1;
  return result;
}

}  // namespace

void add_variance(const std::vector<PointSupport>& points, std::span<const int> tissue, int requested,
                  std::vector<int>& slot, std::vector<LowerRow>& rows) {
  const Influence of = influence_of(points, tissue, requested, slot);
  tbb::parallel_for(std::size_t{0}, of.nodes.size(), [&](std::size_t n) {
    if (n % 1024 == 0) stop_if_requested();
    const auto a = static_cast<std::size_t>(of.nodes[n]);
    thread_local std::vector<double> sum;          // all zero between rows
    thread_local std::vector<std::uint64_t> seen;  // a bit for each column; likewise
    if (sum.size() < rows.size()) {
      sum.resize(rows.size(), 0.0);
      seen.resize(rows.size() / 64 + 1, 0);
    }
    int lowest = static_cast<int>(a);
    const auto add = [&](const int* column, const double* value, std::size_t count) {
      lowest = std::min(lowest, column[0]);
      for (std::size_t m = 0; m < count; ++m) {
        const auto b = static_cast<std::size_t>(column[m]);
        seen[b / 64] |= std::uint64_t{1} << (b % 64);
        sum[b] += value[m];
      }
    };
    LowerRow& row = rows[a];
    if (!row.column.empty()) add(row.column.data(), row.value.data(), row.column.size());
    for (std::size_t i = of.offset[n]; i < of.offset[n + 1]; ++i) {
      const PointSupport& point = points[static_cast<std::size_t>(of.place[i].first)];
      const auto k = static_cast<std::size_t>(of.place[i].second);
      add(point.nodes.data(), point.variance.data() + k * (k + 1) / 2, k + 1);
    }
    std::size_t count = 0;
    const std::size_t from = static_cast<std::size_t>(lowest) / 64;
    for (std::size_t word = from; word <= a / 64; ++word)
      count += static_cast<std::size_t>(std::popcount(seen[word]));
    if (count > row.column.size()) row = {std::vector<int>(count), std::vector<double>(count)};
    std::size_t at = 0;
    for (std::size_t word = from; word <= a / 64; ++word)
      for (; seen[word] != 0; seen[word] &= seen[word] - 1) {
        const std::size_t b = 64 * word + static_cast<std::size_t>(std::countr_zero(seen[word]));
        row.column[at] = static_cast<int>(b);
        row.value[at++] = sum[b];
        sum[b] = 0.0;
      }
  });
}

void unfold(std::vector<LowerRow>& lower, GradientVariance& result) {
  const std::size_t n = lower.size();
  std::vector<int> next(n + 1, 0);
  for (std::size_t a = 0; a < n; ++a)
    for (const int b : lower[a].column) {
      ++next[a];
      if (b != static_cast<int>(a)) ++next[static_cast<std::size_t>(b)];
    }
  result.rows.offset.resize(static_cast<Index>(n) + 1);
  result.rows.offset[0] = 0;
  for (std::size_t a = 0; a < n; ++a) {
    const auto row = static_cast<Index>(a);
    result.rows.offset[row + 1] = result.rows.offset[row] + next[a];
    next[a] = result.rows.offset[row];
  }
  result.rows.member.resize(result.rows.offset[static_cast<Index>(n)]);
  result.K.resize(result.rows.member.size());
  // Rows ascending: all columns below a have entered row a before those above it.
  for (std::size_t a = 0; a < n; ++a) {
    const LowerRow row = std::move(lower[a]);
    for (std::size_t k = 0; k < row.column.size(); ++k) {
      const auto b = static_cast<std::size_t>(row.column[k]);
      result.rows.member[next[a]] = row.column[k];
      result.K[next[a]++] = row.value[k];
      if (b == a) continue;
      result.rows.member[next[b]] = static_cast<int>(a);
      result.K[next[b]++] = row.value[k];
    }
    lower[a] = {};
  }
}

}  // namespace dimple
