#include "preprocess/output/lattice_field.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "io/stop.hpp"

namespace dimple {
namespace {

// Lattice of every other point along each axis.
LatticeField coarsened(const LatticeField& fine) {
  LatticeField coarse;
  for (std::size_t a = 0; a < 3; ++a) coarse.n[a] = (fine.n[a] - 1) / 2 + 1;
  coarse.known.resize(static_cast<std::size_t>(coarse.points()));
  coarse.v.resize(3 * coarse.known.size());
  for (Index c = 0; c < coarse.n[2]; ++c)
    for (Index b = 0; b < coarse.n[1]; ++b)
      for (Index a = 0; a < coarse.n[0]; ++a) {
        const auto to = static_cast<std::size_t>(coarse.number(a, b, c)),
                   from = static_cast<std::size_t>(fine.number(2 * a, 2 * b, 2 * c));
        coarse.known[to] = fine.known[from];
        for (std::size_t r = 0; r < 3; ++r) coarse.v[3 * to + r] = fine.v[3 * from + r];
      }
  return coarse;
}

void refine(const LatticeField& coarse, LatticeField& fine) {
  tbb::parallel_for(Index{0}, fine.n[2], [&](Index c) {
    stop_if_requested();
    for (Index b = 0; b < fine.n[1]; ++b)
      for (Index a = 0; a < fine.n[0]; ++a) {
        const auto to = static_cast<std::size_t>(fine.number(a, b, c));
        if (fine.known[to]) continue;
        const std::array<Index, 3> at{a, b, c};
        std::array<std::array<Index, 2>, 3> near;
        for (std::size_t d = 0; d < 3; ++d)
          near[d] = {std::min(at[d] / 2, coarse.n[d] - 1), std::min((at[d] + 1) / 2, coarse.n[d] - 1)};
        std::array<float, 3> sum{};
        for (std::size_t corner = 0; corner < 8; ++corner) {
          const auto from = static_cast<std::size_t>(
              coarse.number(near[0][corner & 1], near[1][corner >> 1 & 1], near[2][corner >> 2 & 1]));
          for (std::size_t r = 0; r < 3; ++r) sum[r] += coarse.v[3 * from + r];
        }
        for (std::size_t r = 0; r < 3; ++r) fine.v[3 * to + r] = 0.125f * sum[r];
      }
  });
}

// Relaxes each point towards the mean of its neighbours, alternately by colour: independent of the order.
void smooth(LatticeField& level, const Vec3& weight, int sweeps) {
  constexpr float over = 1.5f;
  const std::array<Index, 3> stride{1, level.n[0], level.n[0] * level.n[1]};
  for (int half = 0; half < 2 * sweeps; ++half) {
    tbb::parallel_for(Index{0}, level.n[2], [&](Index c) {
      stop_if_requested();
      for (Index b = 0; b < level.n[1]; ++b)
        for (Index a = (b + c + half) % 2; a < level.n[0]; a += 2) {
          const Index m = level.number(a, b, c);
          if (level.known[static_cast<std::size_t>(m)]) continue;
          const std::array<Index, 3> at{a, b, c};
          std::array<float, 3> sum{};
          float all = 0.0f;
          for (std::size_t d = 0; d < 3; ++d) {
            const float w = static_cast<float>(weight[static_cast<Index>(d)]);
            for (const Index side : {-1, 1}) {
              if (at[d] + side < 0 || at[d] + side >= level.n[d]) continue;
              const float* other = level.v.data() + 3 * (m + side * stride[d]);
              for (std::size_t r = 0; r < 3; ++r) sum[r] += w * other[r];
              all += w;
            }
          }
          float* own = level.v.data() + 3 * m;
          for (std::size_t r = 0; r < 3; ++r) own[r] += over * (sum[r] / all - own[r]);
        }
    });
  }
}

}  // namespace

void continue_smoothly(LatticeField& level, const Vec3& weight) {
  constexpr Index coarsest = 6;
  if (*std::min_element(level.n.begin(), level.n.end()) < 2 * coarsest) {
    smooth(level, weight, 60);
    return;
  }
  LatticeField coarse = coarsened(level);
  continue_smoothly(coarse, weight);
  refine(coarse, level);
  smooth(level, weight, 8);
}

}  // namespace dimple
