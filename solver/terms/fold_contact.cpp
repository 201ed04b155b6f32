#include "solver/terms/fold_contact.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <numeric>

#include "solver/material.hpp"

// Self-contact of folds, for each sample s of both surfaces:
// 1. n_s = cof(F) N, normalised: normal of the opposite surface, turned by the tissue at its place y_s.
// 2. gap_s = n_s . (x_s - y_s); a sample outside the opposite surface has no contact.
// 3. The force lambda_s n_s acts at the sample, its opposite at the foot of the gap.
// 4. Accepted state: a sample that has slid by half a spacing faces the nearest opposite sample, or none.
// 5. Another one is represented by its part with the smallest gap, for curved surfaces (nearest_row()).
// 6. Find the feet of the gaps again; new pairs make ContactCoupling find its compliance again.
//
// Source:   Wriggers 2006, chapters 4 and 5 (see ContactTerm).
// Departs:  samples on both surfaces, without friction, and pairs that are fixed during a search.

namespace dimple {
namespace {

constexpr double slides = 0.5;           // spacings of slip, beyond which another opposite place is found
constexpr double search_distance = 0.5;  // spacings: a gap that may close in the next step
constexpr double max_tangential_offset = 1.5;  // spacings outside all samples of a surface
// Spacings. A surface that is deeper below another is the far side of thin tissue. New contact cannot begin
// deep inside, which no load step, however short, could resolve.
constexpr double behind = -0.25, behind_at_first = -0.05;
constexpr double faces = -0.5;  // largest cosine between the outward normals of opposite surfaces
// Spacings by which the foot of a gap may move before its forces follow; it bounds their couple.
constexpr double foot_moves = 0.005;

}  // namespace

FoldContact::FoldContact(std::shared_ptr<const FoldFaces> fold_faces, const ForceSystem& tissue)
    : fold_faces_(std::move(fold_faces)),
      of_opposite_(turning(fold_faces_->point, tissue)),
      of_own_(turning(fold_faces_->own_point, tissue)),
      faced_(static_cast<std::size_t>(fold_faces_->count()), undeformed) {
  force_.setZero(count());
  gap_.setZero(count());
  normal_ = fold_faces_->opposite_normal;
  row_.resize(static_cast<std::size_t>(count()));
  std::iota(row_.begin(), row_.end(), Index{0});
  foot_ = feet(Nodal());
  pair_up();
}

FoldContact::Turning FoldContact::turning(const std::vector<Index>& point, const ForceSystem& tissue) {
  Turning result;
  const auto count = static_cast<Index>(point.size());
  result.rows.offset = Eigen::VectorXi::Zero(count + 1);
  std::vector<int> member, node;
  std::vector<double> all;
  Points dphi;
  for (Index s = 0; s < count; ++s) {
    tissue.gradients_at(point[static_cast<std::size_t>(s)], node, dphi);
    member.insert(member.end(), node.begin(), node.end());
    all.insert(all.end(), dphi.data(), dphi.data() + 3 * static_cast<Index>(node.size()));
    result.rows.offset[s + 1] = static_cast<int>(member.size());
  }
  result.rows.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  result.dphi = Eigen::Map<Points>(all.data(), 3, static_cast<Index>(member.size()));
  return result;
}

Mat3 FoldContact::gradient(const Turning& by, Index s, const Nodal& u) {
  Mat3 F = Mat3::Identity();
  for (int k = by.rows.offset[s]; k < by.rows.offset[s + 1]; ++k)
    F += u.col(by.rows.member[k]).head<3>() * by.dphi.col(k).transpose();
  return F;
}

Vec3 FoldContact::turned(const Turning& by, Index s, const Nodal& u, const Vec3& normal) {
  return (cofactor(gradient(by, s, u)) * normal).normalized();
}

FoldContact::FoldFace FoldContact::fold_face_of(Index s) const {
  const int faced = faced_[static_cast<std::size_t>(s)];
  if (faced >= 0)
    return {fold_faces_->sample.place.col(faced), fold_faces_->sample.normal.col(faced), of_own_, faced};
  return {fold_faces_->opposite.col(row_[static_cast<std::size_t>(s)]), fold_faces_->opposite_normal.col(s),
          of_opposite_, s};
}

// [3xM] m: from the opposite place to below the sample, along that surface at rest; without displacements: at
// rest.
Points FoldContact::feet(const Nodal& u) const {
  Points result = Points::Zero(3, count());
  for (Index s = 0; s < count(); ++s) {
    if (faced_[static_cast<std::size_t>(s)] == beyond) continue;
    const FoldFace fold_face = fold_face_of(s);
    const Index row = row_[static_cast<std::size_t>(s)];
    Mat3 F = Mat3::Identity();
    Vec3 apart = fold_faces_->sample.place.col(row) - fold_face.place;
    if (u.cols() > 0) {
      F = gradient(fold_face.by, fold_face.turns, u);
      apart += moved(s, u) + (F - Mat3::Identity()) * foot_.col(s);
      if (!(F.determinant() > 0.0)) continue;
    }
    const Vec3 n = (cofactor(F) * fold_face.normal).normalized();
    const Vec3 tangential = apart - apart.dot(n) * n;
    if (tangential.norm() > max_tangential_offset * fold_faces_->spacing[s]) continue;
    const Vec3 foot = F.inverse() * tangential;
    result.col(s) = foot - foot.dot(fold_face.normal) * fold_face.normal;
  }
  return result;
}

// Displacement of the sample relative to the foot of its gap.
Vec3 FoldContact::moved(Index s, const Nodal& u) const {
  Vec3 sum = Vec3::Zero();
  for (int k = moves_.rows.offset[s]; k < moves_.rows.offset[s + 1]; ++k)
    sum += moves_.weight[k] * u.col(moves_.rows.member[k]).head<3>();
  return sum;
}

// Weights that move the gaps: shape functions at the samples, minus those at the opposite places, minus their
// gradients times the vector to the foot of the gap. The forces on both surfaces then have one line of
// action and are the derivative of the gap: n . F T = 0 for every tangent T, so that dn . F T = -n . dF T.
void FoldContact::pair_up() {
  std::vector<int> member;
  std::vector<double> weight;
  moves_.rows.offset = Eigen::VectorXi::Zero(count() + 1);
  for (Index s = 0; s < count(); ++s) {
    std::map<int, double> sum;
    const auto add = [&](const Interpolation& one, Index row, double sign) {
      for (int k = one.rows.offset[row]; k < one.rows.offset[row + 1]; ++k)
        sum[one.rows.member[k]] += sign * one.weight[k];
    };
    const int faced = faced_[static_cast<std::size_t>(s)];
    const Index row = row_[static_cast<std::size_t>(s)];
    add(fold_faces_->sample.at_place, row, 1.0);
    if (faced >= 0)
      add(fold_faces_->sample.at_place, faced, -1.0);
    else
      add(fold_faces_->at_opposite, row, -1.0);
    const FoldFace fold_face = fold_face_of(s);
    for (int k = fold_face.by.rows.offset[fold_face.turns]; k < fold_face.by.rows.offset[fold_face.turns + 1];
         ++k)
      sum[fold_face.by.rows.member[k]] -= fold_face.by.dphi.col(k).dot(foot_.col(s));
    for (const auto& [node, w] : sum) {
      member.push_back(node);
      weight.push_back(w);
    }
    moves_.rows.offset[s + 1] = static_cast<int>(member.size());
  }
  moves_.rows.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  moves_.weight = Eigen::Map<Eigen::VectorXd>(weight.data(), static_cast<Index>(weight.size()));
}

void FoldContact::add_force(const Nodal& u, const Instant&, Nodal& f) {
  const CellMeans& sample = fold_faces_->sample;
  travel_.resize(count());
  for (Index s = 0; s < count(); ++s) {
    const int faced = faced_[static_cast<std::size_t>(s)];
    const Index row = row_[static_cast<std::size_t>(s)];
    const FoldFace fold_face = fold_face_of(s);
    const Mat3 F = gradient(fold_face.by, fold_face.turns, u);
    const Vec3 displacement = moved(s, u) + (F - Mat3::Identity()) * foot_.col(s);
    const Vec3 apart = sample.place.col(row) - fold_face.place + displacement;
    const Vec3 n = normal_.col(s) = (cofactor(F) * fold_face.normal).normalized();
    gap_[s] = n.dot(apart);
    // Opposite surfaces need not be parallel: at rest the vector between them is along neither.
    travel_[s] = (displacement - displacement.dot(n) * n).norm();
    // The plane represents the surface only near its place.
    const double near = max_tangential_offset *
                        std::max(fold_faces_->spacing[s], faced >= 0 ? fold_faces_->spacing[faced] : 0.0);
    if (faced == beyond || (apart - gap_[s] * n).norm() > near) gap_[s] = fold_faces_->spacing[s];
  }
  spread(force_, f);
}

double FoldContact::gap_of(Index row, Index s, const Nodal& u) const {
  Vec3 apart = fold_faces_->sample.place.col(row) - fold_faces_->opposite.col(row);
  const auto add = [&](const Interpolation& one, double sign) {
    for (int k = one.rows.offset[row]; k < one.rows.offset[row + 1]; ++k)
      apart += sign * one.weight[k] * u.col(one.rows.member[k]).head<3>();
  };
  add(fold_faces_->sample.at_place, 1.0);
  add(fold_faces_->at_opposite, -1.0);
  return turned(of_opposite_, s, u, fold_faces_->opposite_normal.col(s)).dot(apart);
}

// Row whose place represents a sample that still faces its place at rest: a part replaces the whole if its
// gap is smaller by `bulges` spacings, and another part if its gap is smaller by as much again.
Index FoldContact::nearest_row(Index s, const Nodal& u) const {
  const double less = FoldFaces::bulges * fold_faces_->spacing[s];
  const Index now = row_[static_cast<std::size_t>(s)];
  Index best = s;
  double nearest = gap_of(s, s, u) - less;
  for (Index row = fold_faces_->part_begin(s); row < fold_faces_->part_end[static_cast<std::size_t>(s)];
       ++row) {
    if (const double gap = gap_of(row, s, u) - (row == now ? less : 0.0); gap < nearest) {
      nearest = gap;
      best = row;
    }
  }
  return best;
}

// Nearest sample of an opposite surface, across the gap between them.
int FoldContact::find_faced(Index s, const Points& place, const Points& normal) const {
  int best = beyond;
  double nearest = 0.0;
  for (Index t = 0; t < count(); ++t) {
    const Vec3 d = place.col(s) - place.col(t);
    const double distance = d.squaredNorm(), height = d.dot(normal.col(t));
    if ((best >= 0 && distance >= nearest) || normal.col(t).dot(normal.col(s)) > faces ||
        height < (force_[s] > 0.0 ? behind : behind_at_first) * fold_faces_->spacing[t])
      continue;
    if ((d - height * normal.col(t)).norm() >
        max_tangential_offset * std::max(fold_faces_->spacing[s], fold_faces_->spacing[t]))
      continue;
    best = static_cast<int>(t);
    nearest = distance;
  }
  return best;
}

void FoldContact::accept(const Nodal& u, const Instant&) {
  if (travel_.size() == 0) return;
  std::vector<Index> slid, row = row_;
  for (Index s = 0; s < count(); ++s) {
    if (faced_[static_cast<std::size_t>(s)] != undeformed || travel_[s] > slides * fold_faces_->spacing[s]) {
      slid.push_back(s);
      row[static_cast<std::size_t>(s)] = s;
    } else if (gap_[s] < search_distance * fold_faces_->spacing[s]) {
      row[static_cast<std::size_t>(s)] = nearest_row(s, u);
    }
  }
  std::vector<int> faced = faced_;
  if (!slid.empty()) {
    const Points place =
        (fold_faces_->sample.place + fold_faces_->sample.at_place(u.topRows<3>())).leftCols(count());
    Points normal(3, count());
    for (Index s = 0; s < count(); ++s)
      normal.col(s) = turned(of_own_, s, u, fold_faces_->sample.normal.col(s));
    for (const Index s : slid) faced[static_cast<std::size_t>(s)] = find_faced(s, place, normal);
  }
  const bool same = faced == faced_ && row == row_;
  if (!same) {
    faced_ = std::move(faced);
    row_ = std::move(row);
    foot_.setZero();
    pair_up();
    ++pairing_;
  }
  Points foot = feet(u);
  bool moves = !same;
  for (Index s = 0; s < count(); ++s)
    moves = moves || (foot.col(s) - foot_.col(s)).norm() > foot_moves * fold_faces_->spacing[s];
  if (!moves) return;
  foot_ = std::move(foot);
  pair_up();
}

std::vector<double> FoldContact::past() const {
  std::vector<double> all(faced_.begin(), faced_.end());
  all.insert(all.end(), row_.begin(), row_.end());
  all.insert(all.end(), foot_.data(), foot_.data() + foot_.size());
  return all;
}

void FoldContact::restore_past(const std::vector<double>& past) {
  faced_.assign(past.begin(), past.begin() + count());
  row_.assign(past.begin() + count(), past.begin() + 2 * count());
  foot_ = Eigen::Map<const Points>(past.data() + 2 * count(), 3, count());
  pair_up();
  ++pairing_;
}

FoldContact::Audit FoldContact::audit() const {
  Audit sum;
  for (Index s = 0; s < count(); ++s) {
    sum.penetration = std::max(sum.penetration, -gap_[s]);
    if (!(force_[s] > 0.0)) continue;
    ++sum.in_contact;
    sum.area += 0.5 * fold_faces_->sample.area[s];
    sum.force += force_[s];
    sum.slid = std::max(sum.slid, travel_[s]);
  }
  return sum;
}

}  // namespace dimple
