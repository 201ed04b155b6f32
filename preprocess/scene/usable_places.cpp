#include "preprocess/scene/usable_places.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/scene/patch_place.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

constexpr double most_looked_at = 3000.0;  // examined places

std::string side_of(const BodySurface& body, const Vec3& local) {
  return side_towards(body.to_world().linear() * local);
}

bool reaches_base(const Boundary& boundary, const Vec3& x) {
  return boundary.lowest - x.dot(boundary.down) <= boundary.base_depth;
}

struct Judged {
  UsablePlace::Verdict verdict = UsablePlace::Verdict::good;
  std::string reason;
};

// Judgement of a patch that find_boundary() has accepted.
Judged judged(const BodySurface& body, const Boundary& at, const Beneath& what) {
  using enum UsablePlace::Verdict;
  if (reaches_base(at, at.centre)) return {refused, "on the fixed base"};
  if (body.at_image_end(at.centre)) return {doubtful, "where the image ends, not the organ"};
  if (will_bend(what.bending))
    return {
        doubtful,
        fmt::format(
            "free to bend: {:.1f} mm of tissue under a contact patch of {:.4g} mm, nothing fixed behind it",
            what.thickness_mm, 2.0 * at.radius)};
  if (at.room < little_room * at.radius)
    return {doubtful,
            fmt::format("little room: a fold, an edge or a steep slope {:.1f} mm from its middle", at.room)};
  return {};
}

UsablePlace described(const BodySurface& body, const Boundary& at) {
  UsablePlace place{.from = side_of(body, -at.approach),
                    .centre = body.to_world() * at.centre,
                    .approach = body.to_world().linear() * at.approach,
                    .base = side_of(body, at.down),
                    .room_mm = at.room,
                    .beneath = beneath(body, at),
                    .reason = {}};
  const Judged said = judged(body, at, place.beneath);
  place.verdict = said.verdict;
  place.reason = said.reason;
  return place;
}

// Judgement of a place of the survey, in few words.
Judged judged(const BodySurface& body, const Boundary& boundary, const SurveyedPlace& place) {
  using enum UsablePlace::Verdict;
  if (place.room.whole < boundary.radius) return {refused, "the contact patch would extend beyond an edge"};
  if (reaches_base(boundary, place.contact)) return {refused, "on the fixed base"};
  if (body.at_image_end(place.contact)) return {doubtful, "the image ends there, not the organ"};
  if (will_bend(place.bending)) return {doubtful, "free to bend: thin tissue, nothing fixed behind it"};
  if (place.room.even < little_room * boundary.radius)
    return {doubtful, "little room: a fold, an edge or a steep slope is near"};
  return {};
}

Boundary moved(const Boundary& boundary, const SurveyedPlace& to) {
  Boundary result = boundary;
  result.centre = to.contact;
  result.room = to.room.even;
  return result;
}

struct Surveyed {
  std::vector<SurveyedPlace> good, doubtful;  // the highest first
  int looked_at = 0;
  std::map<std::string, int> against;
};

Surveyed surveyed(const BodySurface& body, const Boundary& boundary) {
  const View view(body, moments_of(body), boundary.approach);
  const double stride =
      std::max(boundary.radius, std::sqrt(Eigen::Vector2d(view.high - view.low).prod() / most_looked_at));
  const auto is_free = [&](const Vec3& leaves) { return !reaches_base(boundary, leaves); };
  Surveyed result;
  for (const SurveyedPlace& place : survey(view, boundary.radius, stride, is_free)) {
    ++result.looked_at;
    const Judged said = judged(body, boundary, place);
    if (!said.reason.empty()) ++result.against[said.reason];
    if (said.verdict == UsablePlace::Verdict::good) result.good.push_back(place);
    if (said.verdict == UsablePlace::Verdict::doubtful) result.doubtful.push_back(place);
  }
  for (auto* places : {&result.good, &result.doubtful})
    std::stable_sort(places->begin(), places->end(), [](const SurveyedPlace& a, const SurveyedPlace& b) {
      return a.mean_height > b.mean_height;
    });
  return result;
}

// Adds places that are `apart` from each other and from those already chosen.
void add_far_apart(const BodySurface& body, const Boundary& boundary,
                   const std::vector<SurveyedPlace>& places, double apart, std::size_t most,
                   std::vector<Vec3>& taken, std::vector<UsablePlace>& result) {
  for (const SurveyedPlace& place : places) {
    if (result.size() >= most) return;
    const auto near = [&](const Vec3& other) { return (other - place.contact).norm() < apart; };
    if (std::any_of(taken.begin(), taken.end(), near)) continue;
    UsablePlace found = described(body, moved(boundary, place));
    if (found.verdict == UsablePlace::Verdict::refused) continue;
    taken.push_back(place.contact);
    result.push_back(std::move(found));
  }
}

double apart_on(const BodySurface& body, double radius) {
  return std::max(4.0 * radius, 0.25 * moments_of(body).size);
}

}  // namespace

Beneath beneath(const BodySurface& body, const Boundary& boundary) {
  Beneath result;
  Index axis = 0;
  boundary.approach.cwiseAbs().minCoeff(&axis);
  const Vec3 e1 = (Vec3::Unit(axis) - boundary.approach[axis] * boundary.approach).normalized(),
             e2 = boundary.approach.cross(e1);
  Vec3 normal = Vec3::Zero();
  int met = 0, bending = 0;
  const auto look = [&](double r, double angle) {
    const Vec3 x = boundary.centre + r * (std::cos(angle) * e1 + std::sin(angle) * e2);
    const std::vector<double> t = body.crossings(x, boundary.approach);
    if (t.size() < 2) return;
    ++met;
    result.thickness_mm += t[1] - t[0];
    bending += t[1] - t[0] < 2.0 * boundary.radius * bending_thickness &&
               !reaches_base(boundary, x + t[1] * boundary.approach);
    normal -= body.normal().col(body.closest(x + t[0] * boundary.approach).triangle);
  };
  look(0.0, 0.0);
  for (const auto& [fraction, count] : {std::pair{0.5, 6}, {0.9, 12}})
    for (int k = 0; k < count; ++k) look(fraction * boundary.radius, 2.0 * std::numbers::pi * k / count);
  if (met == 0) return result;
  result.thickness_mm /= met;
  result.bending = static_cast<double>(bending) / met;
  const double cosine = std::clamp(normal.normalized().dot(boundary.approach), -1.0, 1.0);
  result.tilt_degrees = std::acos(cosine) * 180.0 / std::numbers::pi;
  return result;
}

const char* word_of(UsablePlace::Verdict verdict) {
  return verdict == UsablePlace::Verdict::good       ? "good"
         : verdict == UsablePlace::Verdict::doubtful ? "doubtful"
                                                     : "refused";
}

UsablePlaces usable_places(const BodySurface& body, const BoundaryOptions& options, int most) {
  UsablePlaces result;
  std::optional<Boundary> own;
  std::optional<ModelError> why_not;
  const auto add = [&](const std::string& side, const BoundaryOptions& there, const Boundary* known) {
    stop_if_requested();
    UsablePlace place;
    place.from = side;
    try {
      const Boundary at = find_boundary(body, there, known);
      place = described(body, at);
      if (side.empty()) own = at;
    } catch (const ModelError& error) {
      if (side.empty()) why_not = error;
      place.verdict = UsablePlace::Verdict::refused;
      place.reason = error.report.fact;
    }
    result.sides.push_back(std::move(place));
  };
  add("", options, nullptr);
  if (!own) result.sides.clear();  // then the sides alone, if the patch fits on one of them
  for (const char* side : names_of_sides) {
    if (own && result.sides.front().from == side) continue;
    BoundaryOptions there = options;
    there.indent_at = side;
    there.direction = "auto";
    // A base that the axes decide is opposite to the tool: no search for cut faces is necessary.
    if (own && own->base_by_axes) there.base = side_towards(-*side_named(side, "side"));
    add(side, there, own && !own->base_by_axes ? &*own : nullptr);
  }
  if (why_not && std::all_of(result.sides.begin(), result.sides.end(), [](const UsablePlace& place) {
        return place.verdict == UsablePlace::Verdict::refused;
      }))
    throw *why_not;
  if (!own) return result;
  const Surveyed all = surveyed(body, *own);
  result.looked_at = all.looked_at;
  result.against = all.against;
  std::vector<Vec3> taken = {own->centre};
  for (const auto* places : {&all.good, &all.doubtful})
    add_far_apart(body, *own, *places, apart_on(body, own->radius), static_cast<std::size_t>(most), taken,
                  result.others);
  return result;
}

std::optional<UsablePlace> next_better_place(const BodySurface& body, const Boundary& than) {
  for (const SurveyedPlace& place : surveyed(body, than).good) {
    if ((place.contact - than.centre).norm() < 4.0 * than.radius) continue;
    UsablePlace found = described(body, moved(than, place));
    if (found.verdict == UsablePlace::Verdict::good) return found;
  }
  return std::nullopt;
}

}  // namespace dimple
