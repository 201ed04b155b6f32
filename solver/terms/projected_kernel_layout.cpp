// Builds the layout that is drawn at the top of projected_kernel.cpp.

#include <tbb/parallel_invoke.h>

#include <algorithm>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/terms/projected_kernel.hpp"
#include "solver/text.hpp"

namespace dimple {

template <class Real>
ProjectedKernel<Real>::ProjectedKernel(const Model& model, const Tissues& tissues)
    : nodes_(model.node_count()),
      points_(model.point_count()),
      patches_(model.patches.count()),
      blocks_((points_ + points_per_block - 1) / points_per_block),
      material_(tissues.material),
      tissue_(tissues.of_point.begin(), tissues.of_point.end()) {
  patch_volume_.assign(model.patches.volume.begin(), model.patches.volume.end());
  tbb::parallel_invoke([&] { lay_out_supports(model); },
                       [&] {
                         if (patches_ > 0) lay_out_patches(model);
                         lay_out_points(model);
                         lay_out_variance(model);
                       });
  slope_ = is_as_printed(material_.front()) ? Real(0) : Real(1);
  smallest_J_ = static_cast<Real>(patches_ > 0 ? smallest_J : 1e-4);
}

// The members of each block, numbered within it; `local` [rows.member] receives those numbers.
template <class Real>
void ProjectedKernel<Real>::number_blocks(const CompressedRows& rows, Index members, Places& places,
                                          std::vector<std::int32_t>& local) const {
  std::vector<std::int32_t> seen(static_cast<std::size_t>(members), -1);
  local.resize(static_cast<std::size_t>(rows.member.size()));
  places.offset.push_back(0);
  std::vector<std::int32_t> count(static_cast<std::size_t>(members) + 1, 0);
  for (Index block = 0; block < blocks_; ++block) {
    const Index first = rows.offset[block * points_per_block],
                last = rows.offset[std::min((block + 1) * points_per_block, points_)];
    const auto start = places.offset.back();
    for (Index k = first; k < last; ++k) {
      auto& number = seen[static_cast<std::size_t>(rows.member[k])];
      if (number < start) {
        number = static_cast<std::int32_t>(places.member.size());
        places.member.push_back(rows.member[k]);
        ++count[static_cast<std::size_t>(rows.member[k]) + 1];
      }
      local[static_cast<std::size_t>(k)] = number - start;
    }
    places.offset.push_back(static_cast<std::int32_t>(places.member.size()));
  }
  for (std::size_t m = 1; m < count.size(); ++m) count[m] += count[m - 1];
  places.of_offset = count;
  places.place.resize(places.member.size());
  for (std::size_t k = 0; k < places.member.size(); ++k)
    places.place[static_cast<std::size_t>(count[static_cast<std::size_t>(places.member[k])]++)] =
        static_cast<std::int32_t>(k);
}

// Gradients of shape functions, four nodes together.
template <class Real>
void ProjectedKernel<Real>::lay_out_supports(const Model& model) {
  std::vector<std::int32_t> local;
  number_blocks(model.support, nodes_, nodes_of_block_, local);
  for (std::size_t b = 0; b + 1 < nodes_of_block_.offset.size(); ++b)
    if (const auto met = nodes_of_block_.offset[b + 1] - nodes_of_block_.offset[b]; met > 1 << 15)
      throw SolveError({.fact = text("the supports of ", points_per_block, " neighbouring points hold ", met,
                                     " nodes, and at most 32768 can be numbered"),
                        .where = text("solver, points from ", static_cast<Index>(b) * points_per_block),
                        .why = "the supports hold too many nodes",
                        .remedy = "use smaller supports (support.radius_factor)"});
  quad_.reserve(static_cast<std::size_t>(model.support.member.size() / 4 + points_ + 1));
  point_offset_.push_back(0);
  for (Index q = 0; q < points_; ++q) {
    if (q % 16384 == 0) stop_if_requested();
    for (Index k = model.support.offset[q]; k < model.support.offset[q + 1]; k += 4) {
      Quad& quad = quad_.emplace_back();
      for (Index i = 0; i < 4; ++i) {
        const bool there = k + i < model.support.offset[q + 1];
        for (int axis = 0; axis < 3; ++axis)
          quad.d[i][axis] = there ? static_cast<Real>(model.dphi(axis, k + i)) : Real(0);
        quad.twice[i] = static_cast<std::uint16_t>(2 * local[static_cast<std::size_t>(there ? k + i : k)]);
      }
    }
    point_offset_.push_back(static_cast<std::int32_t>(quad_.size()));
  }
}

// Lists of patches of each octet of points, and of points of each patch.
template <class Real>
void ProjectedKernel<Real>::lay_out_patches(const Model& model) {
  const CompressedRows& of_point = model.patches.of_point;
  std::vector<std::int32_t> local;
  number_blocks(of_point, patches_, patches_of_block_, local);
  octet_offset_.push_back(0);
  octet_weight_.reserve(4 * local.size());  // about: eight points have half in common
  for (Index q = 0; q < points_; q += 8) {
    if (q % 16384 == 0) stop_if_requested();
    const auto start = static_cast<std::ptrdiff_t>(octet_offset_.back());
    for (Index lane = 0; lane < std::min<Index>(8, points_ - q); ++lane)
      for (int k = of_point.offset[q + lane]; k < of_point.offset[q + lane + 1]; ++k) {
        const std::int32_t mine = local[static_cast<std::size_t>(k)];
        const auto at = static_cast<std::size_t>(
            std::find(octet_number_.begin() + start, octet_number_.end(), mine) - octet_number_.begin());
        if (at == octet_number_.size()) {
          octet_number_.push_back(mine);
          octet_weight_.resize(octet_weight_.size() + 8, Real(0));
        }
        octet_weight_[8 * at + static_cast<std::size_t>(lane)] = static_cast<Real>(model.patches.psi[k]);
      }
    octet_offset_.push_back(static_cast<std::int32_t>(octet_number_.size()));
  }
  Eigen::VectorXi place;
  const CompressedRows members = transpose(of_point, patches_, &place);
  of_patch_.offset.assign(members.offset.begin(), members.offset.end());
  of_patch_.fraction.reserve(static_cast<std::size_t>(members.member.size()));
  for (Index b = 0; b < patches_; ++b)
    for (int k = members.offset[b]; k < members.offset[b + 1]; ++k)
      of_patch_.fraction.push_back(
          {members.member[k], static_cast<Real>(model.patches.psi[place[k]] *
                                                model.volume[members.member[k]] / model.patches.volume[b])});
}

template <class Real>
void ProjectedKernel<Real>::lay_out_variance(const Model& model) {
  for (const GradientVariance& v : model.variance) {
    Variance& mine = variance_.emplace_back();
    mine.tissue = v.tissue;
    mine.rows.offset.assign(v.rows.offset.begin(), v.rows.offset.end());
    mine.rows.fraction.reserve(static_cast<std::size_t>(v.K.size()));
    for (Index k = 0; k < v.K.size(); ++k)
      mine.rows.fraction.push_back({v.rows.member[k], static_cast<Real>(v.K[k])});
  }
}

// Volume, shear modulus and slot of each point.
template <class Real>
void ProjectedKernel<Real>::lay_out_points(const Model& model) {
  points_of_tissue_.assign(material_.size(), 0);
  for (Index q = 0; q < points_; ++q) {
    const auto t = static_cast<std::size_t>(tissue_[static_cast<std::size_t>(q)]);
    volume_.push_back(static_cast<Real>(model.volume[q]));
    mu_.push_back(static_cast<Real>(material_[t].mu));
    slot_.push_back(static_cast<std::int32_t>(points_of_tissue_[t]++));
    plain_ = plain_ && is_plain(material_[t]);
  }
  // Whole octets, padded with zeros.
  for (auto* values : {&volume_, &mu_})
    values->resize(static_cast<std::size_t>(points_ + 7) / 8 * 8, Real(0));
}

template ProjectedKernel<float>::ProjectedKernel(const Model&, const Tissues&);
template ProjectedKernel<double>::ProjectedKernel(const Model&, const Tissues&);

}  // namespace dimple
