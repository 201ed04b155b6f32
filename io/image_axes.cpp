#include "io/image_axes.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace dimple {
namespace {

constexpr double least_turn = 2e-5;    // rad; 5 um at 250 mm
constexpr double cosine_step = 1e-6;   // of the angles between axes
constexpr double least_cosine = 2e-5;  // below, the angle is right

/// Spacings are snapped to this: six significant digits from 1 mm upward, five below.
double spacing_step(double length) {
  const int digits = static_cast<int>(std::floor(std::log10(length)));
  return std::pow(10.0, digits - (length < 1.0 ? 4 : 5));
}

double rounded_to(double x, double step) {
  // Divided by a whole number where the step is below 1: 12345 / 10^5 is the double nearest to 0.12345.
  const double per_mm = std::round(1.0 / step);
  return step < 1.0 ? std::round(x * per_mm) / per_mm : std::round(x / step) * step;
}

/// The rotation nearest to a matrix with det > 0.
Mat3 nearest_rotation(const Mat3& m) {
  const Eigen::JacobiSVD<Mat3> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

}  // namespace

StoredAxes nearest_to_LPS(const Mat3& linear) {
  const Mat3 unit = linear.colwise().normalized();
  constexpr double equal = 1e-4;  // headers of one image differ by less
  StoredAxes best;
  Mat3 best_axes = Mat3::Zero();
  bool found = false;
  std::array<int, 3> stored{0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      StoredAxes order{stored, {(signs & 1) != 0, (signs & 2) != 0, (signs & 4) != 0}};
      Mat3 axes;
      for (int c = 0; c < 3; ++c) {
        const auto a = static_cast<std::size_t>(c);
        axes.col(c) = order.flipped[a] ? Vec3(-unit.col(stored[a])) : Vec3(unit.col(stored[a]));
      }
      if (axes.determinant() <= 0.0) continue;
      double gain = found ? axes.trace() - best_axes.trace() : 1.0;
      for (int e = 0; e < 9 && std::abs(gain) <= equal; ++e) gain = axes(e) - best_axes(e);
      if (gain > equal) best = order, best_axes = axes, found = true;
    }
  } while (std::next_permutation(stored.begin(), stored.end()));
  return best;
}

std::string letters(const StoredAxes& order) {
  std::string text(3, '?');
  for (std::size_t c = 0; c < 3; ++c)
    text[static_cast<std::size_t>(order.stored[c])] = (order.flipped[c] ? "RAI" : "LPS")[c];
  return text;
}

Mat3 snapped(const Mat3& linear) {
  Vec3 spacing = linear.colwise().norm();
  const Mat3 unit = linear * spacing.cwiseInverse().asDiagonal();
  for (double& length : spacing) length = rounded_to(length, spacing_step(length));
  Mat3 cosines = unit.transpose() * unit;
  for (double& c : cosines.reshaped()) c = std::abs(c) < least_cosine ? 0.0 : rounded_to(c, cosine_step);
  const Mat3 shape = cosines.llt().matrixU();  // unit axes with these angles; the identity unless sheared
  Mat3 turn = nearest_rotation(unit * shape.inverse());
  if (Eigen::AngleAxisd(turn).angle() < least_turn) turn.setIdentity();
  return turn * shape * spacing.asDiagonal();
}

double with_twelve_digits(double x) {
  if (!(x > 0.0) || !std::isfinite(x)) return x;
  return rounded_to(x, std::pow(10.0, std::floor(std::log10(x)) - 11));
}

}  // namespace dimple
