#pragma once

// Bodies in parallel projection: lit balls and triangles, the nearest of which is kept at each pixel. Used by
// picture.cpp only.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "io/draw/body_frame.hpp"
#include "io/draw/canvas.hpp"
#include "io/types.hpp"

namespace dimple::draw {

/// A parallel projection: right, up and toward the viewer.
struct Camera {
  Vec3 right, up, toward;
  Vec3 seen(const Vec3& p) const { return {right.dot(p), up.dot(p), toward.dot(p)}; }
};

inline bool usable(const Vec3& p) {
  return p.allFinite();
}

/// Camera above the horizon by `elevation` degrees and turned by `azimuth` degrees about the vertical.
inline Camera camera(const BodyFrame& f, double elevation, double azimuth) {
  const double e = elevation * std::numbers::pi / 180.0, a = azimuth * std::numbers::pi / 180.0;
  const Vec3 right = std::cos(a) * f.broad - std::sin(a) * f.front;
  const Vec3 front = std::sin(a) * f.broad + std::cos(a) * f.front;
  return {right, std::cos(e) * f.up - std::sin(e) * front, std::sin(e) * f.up + std::cos(e) * front};
}

/// Projection of a camera's points into a rectangle.
struct Projection {
  Camera camera;
  Vec2 middle_mm = Vec2::Zero();  ///< shown at the rectangle's centre
  Vec2 centre = Vec2::Zero();     ///< of the rectangle [pixels]
  double scale = 1.0;             ///< pixels per mm

  /// x, y in picture pixels; z in mm toward the viewer.
  Vec3 operator()(const Vec3& p) const {
    const Vec3 q = camera.seen(p);
    return {centre.x() + scale * (q.x() - middle_mm.x()), centre.y() - scale * (q.y() - middle_mm.y()),
            q.z()};
  }
};

/// Fits all points into the rectangle.
inline Projection fitted(const Camera& camera, const Rect& rect,
                         std::initializer_list<const Points*> node_sets, double margin_mm) {
  Eigen::AlignedBox2d box;
  for (const Points* node_set : node_sets)
    for (Index n = 0; n < node_set->cols(); ++n)
      if (usable(node_set->col(n))) box.extend(Vec2(camera.seen(node_set->col(n)).head<2>()));
  Projection projection{.camera = camera, .centre = {rect.x + rect.w / 2.0, rect.y + rect.h / 2.0}};
  if (box.isEmpty()) return projection;
  projection.middle_mm = box.center();
  const Vec2 size = box.sizes().array() + 2.0 * std::max(margin_mm, 1e-6);
  projection.scale = std::min(rect.w / size.x(), rect.h / size.y());
  return projection;
}

/// Pixels with depth for one rectangle; drawn into, shaded, then put on the canvas.
class DepthImage {
 public:
  DepthImage(const Projection& projection, const Rect& rect)
      : projection_(projection),
        x0_(static_cast<int>(rect.x * fine)),
        y0_(static_cast<int>(rect.y * fine)),
        w_(static_cast<int>(rect.w * fine)),
        h_(static_cast<int>(rect.h * fine)),
        depth_(static_cast<std::size_t>(w_ * h_), nothing),
        colour_(depth_.size(), card) {}

  /// A lit ball; `lift_mm` moves it toward the viewer in the test of visibility.
  void ball(const Vec3& centre_mm, double radius_mm, const Colour& colour, double lift_mm = 0.0) {
    const Vec3 p = projection_(centre_mm);
    const double r = std::max(radius_mm * projection_.scale, 0.8) * fine;
    const double cx = p.x() * fine - x0_, cy = p.y() * fine - y0_;
    if (!(cx > -r && cy > -r && cx < w_ + r && cy < h_ + r)) return;
    const int x0 = pixel_within(cx - r, w_ - 1), x1 = pixel_within(cx + r, w_ - 1);
    const int y0 = pixel_within(cy - r, h_ - 1), y1 = pixel_within(cy + r, h_ - 1);
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double u = (x + 0.5 - cx) / r, v = (cy - y - 0.5) / r, remaining = 1.0 - u * u - v * v;
        if (remaining < 0.0) continue;
        const double n = std::sqrt(remaining);
        put(x, y, p.z() + n * radius_mm + lift_mm, [&] { return lit(colour, u, v, n); });
      }
  }

  /// A lit triangle with a normal at each corner; `colour` is a function of the corners' weights.
  template <class ColourAt>
  void triangle(const std::array<Vec3, 3>& corner_mm, const std::array<Vec3, 3>& normal, ColourAt colour) {
    std::array<Vec3, 3> p;
    for (std::size_t c = 0; c < 3; ++c) {
      p[c] = projection_(corner_mm[c]);
      p[c].x() = p[c].x() * fine - x0_;
      p[c].y() = p[c].y() * fine - y0_;
    }
    const double area =
        (p[1].x() - p[0].x()) * (p[2].y() - p[0].y()) - (p[2].x() - p[0].x()) * (p[1].y() - p[0].y());
    if (!(std::abs(area) > 1e-12)) return;
    const auto [low_x, high_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
    const auto [low_y, high_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
    if (high_x < 0.0 || high_y < 0.0 || low_x > w_ || low_y > h_) return;
    std::array<Vec3, 3> seen;  // normals
    for (std::size_t c = 0; c < 3; ++c) seen[c] = projection_.camera.seen(normal[c]);
    // The weights of the corners are linear in x and y.
    const double a_x = (p[1].y() - p[2].y()) / area, a_y = (p[2].x() - p[1].x()) / area;
    const double b_x = (p[2].y() - p[0].y()) / area, b_y = (p[0].x() - p[2].x()) / area;
    const double x2 = p[2].x() - 0.5, y2 = p[2].y() - 0.5;
    const double z0 = p[0].z(), z1 = p[1].z(), z2 = p[2].z();
    const int x0 = pixel_within(low_x, w_ - 1), x1 = pixel_within(high_x, w_ - 1);
    const int y0 = pixel_within(low_y, h_ - 1), y1 = pixel_within(high_y, h_ - 1);
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double a = a_x * (x - x2) + a_y * (y - y2), b = b_x * (x - x2) + b_y * (y - y2);
        const double c = 1.0 - a - b;
        if (a < 0.0 || b < 0.0 || c < 0.0) continue;
        put(x, y, a * z0 + b * z1 + c * z2, [&] {
          const Vec3 n = (a * seen[0] + b * seen[1] + c * seen[2]).normalized();
          return lit(colour(a, b, c), n.x(), n.y(), n.z());
        });
      }
  }

  /// Puts the image on the canvas and darkens pixels behind their surroundings, so that edges and gaps are
  /// visible without colours. `thickness_mm`: the step in depth that gives a clear edge.
  void lay_on(Canvas& canvas, double thickness_mm) const {
    static constexpr int ring = 16;
    static constexpr int dx[ring] = {2, 2, 0, -2, -2, -2, 0, 2, 7, 5, 0, -5, -7, -5, 0, 5};
    static constexpr int dy[ring] = {0, 2, 2, 2, 0, -2, -2, -2, 0, 5, 7, 5, 0, -5, -7, -5};
    const float unit = 1.0F / static_cast<float>(std::max(thickness_mm, 1e-9));
    std::vector<float> hidden(static_cast<std::size_t>(w_));
    for (int y = 0; y < h_; ++y) {
      const float* here = depth_.data() + w_ * y;
      std::fill(hidden.begin(), hidden.end(), 0.0F);
      for (int n = 0; n < ring; ++n) {  // outside, for loops over a row that use vector instructions
        if (y + dy[n] < 0 || y + dy[n] >= h_) continue;
        const float* there = here + dx[n] + w_ * dy[n];
        float* sum = hidden.data();
        const int last = std::min(w_, w_ - dx[n]);
        for (int x = std::max(0, -dx[n]); x < last; ++x) {
          const float step = (there[x] - here[x]) * unit, least = step > 0.0F ? step : 0.0F;
          sum[x] += least < 1.0F ? least : 1.0F;
        }
      }
      for (int x = 0; x < w_; ++x) {
        if (here[x] == nothing) continue;
        const float shade = std::exp(-1.1F * hidden[static_cast<std::size_t>(x)] / ring);
        canvas.blend(x0_ + x, y0_ + y, colour_[static_cast<std::size_t>(x + w_ * y)] * shade, 1.0);
      }
    }
  }

 private:
  static constexpr float nothing = -std::numeric_limits<float>::infinity();

  template <class Shade>
  void put(int x, int y, double depth, Shade shade) {
    const std::size_t i = static_cast<std::size_t>(x + w_ * y);
    if (!(static_cast<float>(depth) > depth_[i])) return;
    depth_[i] = static_cast<float>(depth);
    colour_[i] = shade();
  }

  /// Light from the upper left in front, some ambient light, a soft highlight. Both sides are lit. (x, y, z)
  /// is the unit normal: right, up, toward the viewer.
  Colour lit(const Colour& colour, double x, double y, double z) const {
    if (z < 0.0) x = -x, y = -y, z = -z;
    const double diffuse = std::max(x * light_.x() + y * light_.y() + z * light_.z(), 0.0),
                 sky = 0.5 + 0.5 * y;
    const double gloss = std::max(x * half_.x() + y * half_.y() + z * half_.z(), 0.0), gloss2 = gloss * gloss;
    const double gloss8 = gloss2 * gloss2 * gloss2 * gloss2;
    const auto highlight = static_cast<float>(0.14 * gloss8 * gloss8 * gloss8);
    const auto brightness = static_cast<float>(0.40 + 0.16 * sky + 0.54 * diffuse);
    const auto part = [&](float c) { return std::min(c * brightness + highlight, 1.0F); };
    return {part(colour.red), part(colour.green), part(colour.blue)};
  }

  Vec3 light_ = Vec3(-0.45, 0.65, 0.75).normalized(), half_ = (light_ + Vec3::UnitZ()).normalized();
  Projection projection_;
  int x0_, y0_, w_, h_;
  std::vector<float> depth_;
  std::vector<Colour> colour_;
};

}  // namespace dimple::draw
