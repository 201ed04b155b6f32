#include "solver/material.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "io/error.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

// Below these and smallest_J, powers are replaced by Taylor polynomials: see the header.
constexpr double smallest_J_of_barriers = 0.2;
constexpr double smallest_stretch = 0.1;
constexpr double largest_stiffening = 1e3;
constexpr double smallest_J_of_second_stress = 0.05;
constexpr double largest_fraction_of_limit = 0.98;

template <class... Of>
struct Cases : Of... {
  using Of::operator()...;
};

// Result of the visitor in `cases` that fits the law; a missing one does not compile.
template <class... Of>
auto ask(const Material& m, Of... cases) {
  return std::visit(Cases<Of...>{cases...}, m.law);
}

struct Curve {
  double value, slope;
};

/// x^a, and below x0 its Taylor polynomial of second order at x0.
Curve extended_power(double x, double a, double x0) {
  if (x >= x0) {
    const double power = std::pow(x, a);
    return {power, a * power / x};
  }
  const double d = x / x0 - 1.0, power = std::pow(x0, a);
  return {power * (1.0 + a * d + 0.5 * a * (a - 1.0) * d * d), power * a / x0 * (1.0 + (a - 1.0) * d)};
}

// The determinant below which the law's powers of it are Taylor polynomials.
double least_J(const Ogden& law) {
  const bool barrier =
      std::any_of(law.terms.begin(), law.terms.end(), [](const OgdenTerm& term) { return term.alpha < 0.0; });
  return barrier ? smallest_J_of_barriers : smallest_J;
}

/// J^(-2/3), which makes tr C isochoric; J^(-4/3), which does so for |cof F|^2.
Curve isochoric_factor(double J, double J0 = smallest_J) {
  return extended_power(J, -2.0 / 3.0, J0);
}
Curve isochoric_factor_of_cofactor(double J) {
  return extended_power(J, -4.0 / 3.0, smallest_J);
}

/// l^alpha as a function of c = l^2.
Curve stretch_power(double c, double alpha) {
  double l0 = smallest_stretch;
  if (alpha < 0.0) l0 = std::max(l0, std::pow(largest_stiffening, 1.0 / (alpha - 2.0)));
  return extended_power(c, 0.5 * alpha, l0 * l0);
}

double energy_factor(const OgdenTerm& term) {
  return 2.0 * term.mu / (term.alpha * term.alpha);
}

/// Gent's energy for mu = 1 as a function of x = tr Cbar - 3.
Curve gent_curve(const Gent& law, double x) {
  const double x0 = largest_fraction_of_limit * law.limit, at = std::min(x, x0), left = 1.0 - at / law.limit;
  const Curve there{-0.5 * law.limit * std::log(left), 0.5 / left};
  const double beyond = x - at, second = 0.5 / (law.limit * left * left);
  return {there.value + beyond * (there.slope + 0.5 * second * beyond), there.slope + second * beyond};
}

/// The energy of one stretch at zero, for terms that repel it, times (1 - J / J0)^3 below J0.
Curve collapse(const Ogden& law, double J) {
  Curve sum{0.0, 0.0};
  if (J >= smallest_J_of_barriers) return sum;
  const double d = 1.0 - J / smallest_J_of_barriers;
  for (const OgdenTerm& term : law.terms)
    if (term.alpha < 0.0) {
      const double height = std::abs(energy_factor(term)) * stretch_power(0.0, term.alpha).value;
      sum.value += height * d * d * d;
      sum.slope -= height * 3.0 * d * d / smallest_J_of_barriers;
    }
  return sum;
}

/// Common parts of the first and second stress: P = F A + b cof F, with A symmetric.
struct Parts {
  Mat3 A;
  double b;
};

Parts neo_hookean_parts(double mu, const Mat3& F, double J) {
  const Curve g = isochoric_factor(J);
  return {mu * g.value * Mat3::Identity(), 0.5 * mu * g.slope * F.squaredNorm()};
}

Parts mooney_rivlin_parts(double c10, double c01, const Mat3& F, double J) {
  const Curve g = isochoric_factor(J), h = isochoric_factor_of_cofactor(J);
  const Mat3 C = F.transpose() * F;
  return {2.0 * (c10 * g.value * Mat3::Identity() + c01 * h.value * (C.trace() * Mat3::Identity() - C)),
          c10 * g.slope * C.trace() + c01 * h.slope * cofactor(F).squaredNorm()};
}

Parts gent_parts(double mu, const Gent& law, const Mat3& F, double J) {
  const Curve g = isochoric_factor(J);
  const double trace = F.squaredNorm(), slope = mu * gent_curve(law, g.value * trace - 3.0).slope;
  return {2.0 * slope * g.value * Mat3::Identity(), slope * g.slope * trace};
}

Parts ogden_parts(const Ogden& law, const Mat3& F, double J) {
  const Curve g = isochoric_factor(J, least_J(law));
  const Eigen::SelfAdjointEigenSolver<Mat3> principal(F.transpose() * F);
  const Vec3 c = principal.eigenvalues();
  Vec3 w = Vec3::Zero();
  for (const OgdenTerm& term : law.terms)
    for (int i = 0; i < 3; ++i) w[i] += energy_factor(term) * stretch_power(g.value * c[i], term.alpha).slope;
  const Mat3& N = principal.eigenvectors();
  return {2.0 * g.value * (N * w.asDiagonal() * N.transpose()), g.slope * w.dot(c) + collapse(law, J).slope};
}

Parts stress_parts(const Material& m, const Mat3& F, double J) {
  return ask(
      m, [&](const NeoHookean&) { return neo_hookean_parts(m.mu, F, J); },
      [&](const PrintedNeoHookean&) { return neo_hookean_parts(m.mu, F, J); },
      [&](const Ogden& law) { return ogden_parts(law, F, J); },
      [&](const MooneyRivlin& law) { return mooney_rivlin_parts(0.5 * m.mu - law.c01, law.c01, F, J); },
      [&](const Gent& law) { return gent_parts(m.mu, law, F, J); });
}

double neo_hookean_energy(double mu, const Mat3& F, double J) {
  return 0.5 * mu * (isochoric_factor(J).value * F.squaredNorm() - 3.0);
}

double mooney_rivlin_energy(double c10, double c01, const Mat3& F, double J) {
  return c10 * (isochoric_factor(J).value * F.squaredNorm() - 3.0) +
         c01 * (isochoric_factor_of_cofactor(J).value * cofactor(F).squaredNorm() - 3.0);
}

double ogden_energy(const Ogden& law, const Mat3& F, double J) {
  const Eigen::SelfAdjointEigenSolver<Mat3> principal(F.transpose() * F, Eigen::EigenvaluesOnly);
  const Vec3 c = isochoric_factor(J, least_J(law)).value * principal.eigenvalues();
  double energy = collapse(law, J).value;
  for (const OgdenTerm& term : law.terms) {
    double sum = -3.0;
    for (int i = 0; i < 3; ++i) sum += stretch_power(c[i], term.alpha).value;
    energy += energy_factor(term) * sum;
  }
  return energy;
}

double bulk_modulus(double mu, double nu) {
  return 2.0 * mu * nu / (1.0 - 2.0 * nu) + 2.0 / 3.0 * mu;
}

Mat3 symmetric(const Eigen::Ref<const Eigen::Matrix<double, 6, 1>>& s) {
  return (Mat3() << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2]).finished();
}

}  // namespace

Mat3 cofactor(const Mat3& F) {
  Mat3 result;
  for (int k = 0; k < 3; ++k) result.col(k) = F.col((k + 1) % 3).cross(F.col((k + 2) % 3));
  return result;
}

Material neo_hookean(double mu, double nu, double density, bool as_printed) {
  Material result = {.mu = mu, .kappa = bulk_modulus(mu, nu), .density = density};
  if (as_printed) result.law = PrintedNeoHookean{};
  return result;
}

Material ogden(std::vector<OgdenTerm> terms, double nu, double density) {
  assert(!terms.empty());
  double mu = 0.0;
  for (const OgdenTerm& term : terms) {
    assert(term.alpha != 0.0);
    mu += term.mu;
  }
  return {.mu = mu, .kappa = bulk_modulus(mu, nu), .density = density, .law = Ogden{std::move(terms)}};
}

Material mooney_rivlin(double c10, double c01, double nu, double density) {
  const double mu = 2.0 * (c10 + c01);
  return {.mu = mu, .kappa = bulk_modulus(mu, nu), .density = density, .law = MooneyRivlin{c01}};
}

Material gent(double mu, double limit, double nu, double density) {
  assert(limit > 0.0);
  return {.mu = mu, .kappa = bulk_modulus(mu, nu), .density = density, .law = Gent{limit}};
}

bool relaxes(const std::vector<Material>& tissues) {
  return std::any_of(tissues.begin(), tissues.end(), [](const Material& m) { return !m.prony.empty(); });
}

bool is_plain(const Material& m) {
  return m.prony.empty() &&
         ask(
             m, [](const NeoHookean&) { return true; }, [](const PrintedNeoHookean&) { return true; },
             [](const Ogden&) { return false; }, [](const MooneyRivlin&) { return false; },
             [](const Gent&) { return false; });
}

bool is_as_printed(const Material& m) {
  return std::holds_alternative<PrintedNeoHookean>(m.law);
}

LawWords words_of(const Material& m) {
  return ask(
      m,
      [](const NeoHookean&) {
        return LawWords{"neo-hookean", "neo-Hookean", {}};
      },
      [](const PrintedNeoHookean&) {
        return LawWords{"neo-hookean as printed", "neo-Hookean as printed", {}};
      },
      [](const Ogden& law) {
        LawWords words{"ogden", "Ogden", {}};
        for (const OgdenTerm& term : law.terms)
          words.terms.push_back({{"mu_Pa", term.mu}, {"alpha", term.alpha}});
        return words;
      },
      [&](const MooneyRivlin& law) {
        return LawWords{
            "mooney-rivlin", "Mooney-Rivlin", {{{"c10_Pa", 0.5 * m.mu - law.c01}, {"c01_Pa", law.c01}}}};
      },
      [](const Gent& law) {
        return LawWords{"gent", "Gent", {{{"limit", law.limit}}}};
      });
}

double distortional_energy(const Material& m, const Mat3& F) {
  const double J = F.determinant();
  return ask(
      m, [&](const NeoHookean&) { return neo_hookean_energy(m.mu, F, J); },
      [&](const PrintedNeoHookean&) { return neo_hookean_energy(m.mu, F, J); },
      [&](const Ogden& law) { return ogden_energy(law, F, J); },
      [&](const MooneyRivlin& law) { return mooney_rivlin_energy(0.5 * m.mu - law.c01, law.c01, F, J); },
      [&](const Gent& law) {
        return m.mu * gent_curve(law, isochoric_factor(J).value * F.squaredNorm() - 3.0).value;
      });
}

Mat3 distortional_stress(const Material& m, const Mat3& F) {
  const Parts parts = stress_parts(m, F, F.determinant());
  return F * parts.A + parts.b * cofactor(F);
}

Mat3 distortional_second_stress(const Material& m, const Mat3& F) {
  const double J = F.determinant();
  const Parts parts = stress_parts(m, F, J);
  const Mat3 cof = cofactor(F);
  const double floor = smallest_J_of_second_stress;
  const double inverse_J = J / std::max(J * J, floor * floor);
  return parts.A + parts.b * inverse_J * (cof.transpose() * cof);  // cof C = cof(F)^T cof F
}

Mat3 pk1_stress(const Material& m, const Mat3& F) {
  const double J = F.determinant();
  if (is_as_printed(m))
    return m.mu * isochoric_factor(J).value * F + (m.kappa - 2.0 / 3.0 * m.mu) * (J - 1.0) * cofactor(F);
  const Parts parts = stress_parts(m, F, J);
  return F * parts.A + (m.kappa * (J - 1.0) + parts.b) * cofactor(F);
}

double pointwise_bulk_modulus(const Material& m) {
  return std::min(2.0 / 3.0 * m.mu, m.kappa);
}

double pressure_wave_speed(const Material& m) {
  return std::sqrt((m.kappa + 4.0 / 3.0 * m.mu) / m.density);
}
double shear_wave_speed(const Material& m) {
  return std::sqrt(m.mu / m.density);
}

PronyStep prony_step(const Material& m, double dt) {
  assert(dt >= 0.0);
  PronyStep step;
  for (const PronyTerm& term : m.prony) {
    const double x = dt / term.tau;
    const double a = x == 0.0 ? 1.0 : -std::expm1(-x) / x;
    step.e.push_back(std::exp(-x));
    step.ga.push_back(term.g * a);
    step.c += term.g * (a - 1.0);
  }
  return step;
}

ViscousHistory::ViscousHistory(const Material& of, Index point_count)
    : material(of),
      step(prony_step(of, 0.0)),
      S0(decltype(S0)::Zero(6, point_count)),
      H(decltype(H)::Zero(6 * static_cast<Index>(of.prony.size()), point_count)) {}

Mat3 ViscousHistory::K(Index q) const {
  Eigen::Matrix<double, 6, 1> sum = Eigen::Matrix<double, 6, 1>::Zero();
  for (std::size_t i = 0; i < step.e.size(); ++i)
    sum += step.e[i] * H.col(q).segment<6>(6 * static_cast<Index>(i)) - step.ga[i] * S0.col(q);
  return symmetric(sum);
}

void ViscousHistory::accept(Index q, const Mat3& F) {
  const Mat3 S = distortional_second_stress(material, F);
  const Eigen::Matrix<double, 6, 1> now{S(0, 0), S(1, 1), S(2, 2), S(0, 1), S(1, 2), S(0, 2)};
  for (std::size_t i = 0; i < step.e.size(); ++i) {
    auto h = H.col(q).segment<6>(6 * static_cast<Index>(i));
    h = step.e[i] * h + step.ga[i] * (now - S0.col(q));
  }
  S0.col(q) = now;
}

std::vector<Preset> material_presets() {
  const MaterialNumbers horton{.mu_Pa = 210.0,
                               .nu = 0.499,
                               .density_kg_per_m3 = 1000.0,
                               .ogden_mu_Pa = {},
                               .ogden_alpha = {},
                               .prony_g = {},
                               .prony_tau_s = {}};
  const MaterialNumbers miller_chinzei{.mu_Pa = 842.0,
                                       .nu = 0.499,
                                       .density_kg_per_m3 = 1000.0,
                                       .ogden_mu_Pa = {842.0},
                                       .ogden_alpha = {-4.7},
                                       .prony_g = {0.450, 0.365},
                                       .prony_tau_s = {0.5, 50.0}};
  return {{"horton_2007", horton}, {"miller_chinzei_2002", miller_chinzei}};
}

MaterialNumbers numbers_of_preset(const std::string& name) {
  std::string names;
  for (Preset& preset : material_presets()) {
    if (preset.name == name) return std::move(preset.numbers);
    names += (names.empty() ? "" : ", ") + preset.name;
  }
  throw UsageError({.fact = "there is no material preset '" + name + "'",
                    .where = "material",
                    .why = "presets are named after their paper: family names and year",
                    .remedy = "use one of: " + names});
}

namespace {

[[noreturn]] void refuse_numbers(const std::string& fact, const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fact, .where = "[material]", .why = why, .remedy = remedy});
}

Material ogden_from(const MaterialNumbers& m) {
  if (m.ogden_mu_Pa.size() != m.ogden_alpha.size() || m.ogden_mu_Pa.size() > 3)
    refuse_numbers(text(m.ogden_mu_Pa.size(), " Ogden moduli and ", m.ogden_alpha.size(), " exponents"),
                   "each term has one of both, and there are at most three",
                   "give as many numbers in material.ogden_mu_Pa as in material.ogden_alpha");
  std::vector<OgdenTerm> terms;
  double sum = 0.0;
  for (std::size_t k = 0; k < m.ogden_mu_Pa.size(); ++k) {
    if (m.ogden_alpha[k] == 0.0)
      refuse_numbers("an Ogden exponent is 0", "2 mu / alpha^2 has no meaning then", "give another exponent");
    terms.push_back({m.ogden_mu_Pa[k], m.ogden_alpha[k]});
    sum += m.ogden_mu_Pa[k];
  }
  if (!(sum > 0.0))
    refuse_numbers(text("the Ogden moduli add up to ", sum, " Pa"),
                   "their sum is the shear modulus of small strains, which must be positive",
                   "check the signs and the convention: 2 mu / alpha^2");
  return ogden(std::move(terms), m.nu, m.density_kg_per_m3);
}

Material mooney_rivlin_from(const MaterialNumbers& m) {
  const double c10 = 0.5 * m.mu_Pa - m.mooney_c01_Pa;
  if (c10 < 0.0)
    refuse_numbers(text("c01 is ", m.mooney_c01_Pa, " Pa, more than mu/2, ", 0.5 * m.mu_Pa, " Pa"),
                   "c10 = mu/2 - c01 would be negative, and the tissue would be unstable",
                   "give a smaller material.mooney_c01_Pa or a larger --mu");
  return mooney_rivlin(c10, m.mooney_c01_Pa, m.nu, m.density_kg_per_m3);
}

void set_prony(const MaterialNumbers& m, Material& material) {
  if (m.prony_g.size() != m.prony_tau_s.size())
    refuse_numbers(text(m.prony_g.size(), " relaxing parts and ", m.prony_tau_s.size(), " relaxation times"),
                   "each Prony term has one of both",
                   "give as many numbers in material.prony_g as in prony_tau_s");
  double relaxing = 0.0;
  for (std::size_t k = 0; k < m.prony_g.size(); ++k) {
    if (!(m.prony_g[k] > 0.0) || !(m.prony_tau_s[k] > 0.0))
      refuse_numbers(
          text("a Prony term is not positive: ", m.prony_g[k], " of the modulus in ", m.prony_tau_s[k], " s"),
          "a part of the modulus relaxes within some time",
          "give positive numbers, or none for tissue that does not relax");
    material.prony.push_back({m.prony_g[k], m.prony_tau_s[k]});
    relaxing += m.prony_g[k];
  }
  if (relaxing >= 1.0)
    refuse_numbers(text(relaxing, " of the modulus relaxes"), "nothing would be left in the end",
                   "the parts in material.prony_g must add up to less than 1");
}

}  // namespace

Material material_from(const MaterialNumbers& m, bool as_printed) {
  const bool is_ogden = !m.ogden_mu_Pa.empty() || !m.ogden_alpha.empty();
  const bool is_mooney_rivlin = m.mooney_c01_Pa > 0.0, is_gent = m.gent_limit > 0.0;
  if (is_mooney_rivlin + is_gent + is_ogden > 1)
    refuse_numbers("numbers of two laws are given", "a tissue has one law",
                   "leave out all but one of material.mooney_c01_Pa, material.gent_limit, the preset and the "
                   "Ogden numbers");
  Material result = is_ogden           ? ogden_from(m)
                    : is_mooney_rivlin ? mooney_rivlin_from(m)
                    : is_gent          ? gent(m.mu_Pa, m.gent_limit, m.nu, m.density_kg_per_m3)
                                       : neo_hookean(m.mu_Pa, m.nu, m.density_kg_per_m3, as_printed);
  if (as_printed && !is_as_printed(result))
    throw UsageError({.fact = "the printed stress is of a neo-Hookean tissue",
                      .where = "--stress printed (material.stress)",
                      .why = text("another law is requested, ", words_of(result).title),
                      .remedy = "leave --stress out, or the preset and the other law's numbers"});
  set_prony(m, result);
  return result;
}

}  // namespace dimple
