#pragma once

#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "io/types.hpp"

namespace dimple {

// Soft tissue resists a change of shape (mu, hundreds of pascals) far less than a change of volume (kappa, a
// hundred kilopascals). The two parts are kept apart, W = distortional + kappa/2 (J - 1)^2. Only the first
// depends on the law and relaxes in time, and a static solver may use the pressure as an unknown.
//
// Letters: F deformation gradient, C = F^T F, J = det F, l_i the principal stretches: l_i^2 are the
// eigenvalues of C. mu is the shear modulus for small strains, whatever the law.

/// One term of an Ogden law:  2 mu / alpha^2 (l_1^alpha + l_2^alpha + l_3^alpha - 3), of isochoric stretches.
///
/// This is the convention of Abaqus and of the literature on brain: the moduli add up to the shear modulus of
/// small strains. Parameters of other conventions, mu / alpha or c / alpha^2, need conversion.
struct OgdenTerm {
  double mu;     ///< [Pa]; the sum over all terms must be > 0
  double alpha;  ///< not 0; negative ones stiffen in compression, as brain does; 2 is neo-Hookean
};

/// One term of the relaxation function  g(t) = g_inf + sum_i g_i exp(-t / tau_i),  g_inf = 1 - sum_i g_i.
struct PronyTerm {
  double g;    ///< the part of the modulus that relaxes, > 0; the sum over all terms must be < 1
  double tau;  ///< relaxation time [s], > 0
};

// Laws: the energy of distortion as a function of F. Each has a shear modulus for small strains,
// Material::mu. A new law does not compile until every visitor in material.cpp has a case for it.

struct NeoHookean {};
/// The stress exactly as Horton et al. 2007 print it, for comparison: not zero at rest.
struct PrintedNeoHookean {};
struct Ogden {
  std::vector<OgdenTerm> terms;  ///< at least one; their moduli add up to mu
};
struct MooneyRivlin {
  double c01;  ///< [Pa] of the second invariant, 0 ... mu/2; that of the first is c10 = mu/2 - c01
};
struct Gent {
  double limit;  ///< Jm > 0, the value of tr Cbar - 3 at which the chains of the tissue are straight
};
using Law = std::variant<NeoHookean, PrintedNeoHookean, Ogden, MooneyRivlin, Gent>;

/// Isotropic, nearly incompressible solid, elastic or viscoelastic.
struct Material {
  double mu = 210.0;        ///< shear modulus for small strains [Pa], > 0: instantaneous
  double kappa = 104930.0;  ///< bulk modulus [Pa], > 0
  double density = 1000.0;  ///< at rest [kg/m^3]
  Law law = NeoHookean{};
  std::vector<PronyTerm> prony{};  ///< none: elastic
};

/// Tissue by the numbers of its user. Those of other laws are 0 or empty.
struct MaterialNumbers {
  double mu_Pa = 210.0, nu = 0.499, density_kg_per_m3 = 1000.0;
  std::vector<double> ogden_mu_Pa, ogden_alpha;  ///< as many of both; replace mu_Pa
  double mooney_c01_Pa = 0.0;                    ///< at most mu/2
  double gent_limit = 0.0;                       ///< Jm
  std::vector<double> prony_g, prony_tau_s;      ///< as many of both
};
/// Law of the given numbers, neo-Hookean if there are none. `as_printed`: PrintedNeoHookean. Throws
/// UsageError: two laws, or numbers of an unstable tissue.
Material material_from(const MaterialNumbers& numbers, bool as_printed = false);

/// kappa = lambda + 2/3 mu with lambda = 2 mu nu / (1 - 2 nu). The law: NeoHookean, or as printed.
Material neo_hookean(double mu, double nu, double density, bool as_printed = false);

/// mu = sum of the terms' mu; kappa from it and nu as above. Needs: at least one term.
Material ogden(std::vector<OgdenTerm> terms, double nu, double density);

/// mu = 2 (c10 + c01); kappa from it and nu as above.
Material mooney_rivlin(double c10, double c01, double nu, double density);

/// Gent's law; kappa from mu and nu as above. Needs: limit > 0.
Material gent(double mu, double limit, double nu, double density);

/// The stress is that of NeoHookean, and nothing relaxes: what the quick loop of the kernel does, and what
/// finite-element programs are given.
bool is_plain(const Material& material);
/// True if any tissue is viscoelastic.
bool relaxes(const std::vector<Material>& tissues);
/// True for the stress printed in the paper.
bool is_as_printed(const Material& material);

/// A law's name and numbers, for people and for programs: "ogden" and for each term "mu_Pa", "alpha".
struct LawWords {
  std::string name, title;                                         ///< "ogden", "Ogden"
  std::vector<std::vector<std::pair<std::string, double>>> terms;  ///< none where mu says all
};
LawWords words_of(const Material& material);

/// Energy of distortion per reference volume [J/m^3], for any F.
///
///     neo-Hookean   W = mu/2 (g(J) tr C - 3)
///     Mooney-Rivlin W = c10 (g(J) tr C - 3) + c01 (h(J) |cof F|^2 - 3)
///     Gent          W = mu f(g(J) tr C - 3)
///     Ogden         W = sum_p 2 mu_p / alpha_p^2 (sum_i s_p(g(J) l_i^2) - 3) + collapse(J)
///
///     f(x)   = -Jm/2 ln(1 - x / Jm)  for x <= 0.98 Jm, above: its Taylor polynomial of second order there
///     g(J)   = J^(-2/3)       for J >= J0,        below: its Taylor polynomial of second order at J0
///     h(J)   = J^(-4/3)       likewise
///     s_p(c) = c^(alpha_p/2)  for c >= l0^2,      below: its Taylor polynomial of second order at l0^2
///
/// g is the square of the factor that makes stretches isochoric, so that s_p is l^alpha_p of the isochoric
/// stretch l. A term of alpha = 2 is neo-Hookean for every F.
///
/// The energy is extended below J0, as in Stomakhin et al. 2012, so that a point may pass through inversion
/// during the iterations of a solver; the caller reports J <= 0 in the states that it accepts. A smaller J0
/// stiffens points near inversion, but leaves fewer inverted: with 0.05 a fifth of those with 0.2. With
/// a = -2/3, d = J / J0 - 1,
///
///     g = J0^a (1 + a d + a (a - 1) / 2 d^2) = J0^a (1 - 2/3 d + 5/9 d^2),
///
/// positive for every J (the discriminant 4/9 - 20/9 is negative) and falling in J: the neo-Hookean stress
/// always drives an inverted point back.
///
/// s_p is extended because with alpha < 0 it is infinite at l = 0. Its variable is l^2, a smooth function of
/// F, where l has a kink at 0. At l0 the term is 1000 times as stiff as at rest, l0^(alpha - 2) = 1000, but
/// l0 is 0.1 at least, also for alpha > 0. For alpha = -4.7 it is 0.36: a few times as stiff as kappa at nu =
/// 0.499, and far beyond the strains to which such laws are fitted. s_p has no sign of l, so for alpha < 0 it
/// would hold a point inverted: it repels l = 0 from both sides. Hence
///
///     collapse = (1 - J / J0)^3 sum_p 2 |mu_p| / alpha_p^2 s_p(0)   over alpha_p < 0, for J < J0, else 0,
///
/// which outgrows that barrier unless the other two stretches are small as well. A law with such a term has
/// J0 = 0.2: a smaller one acts too late. All pieces join with two continuous derivatives, so that the
/// stiffness is continuous. The law is unchanged for J >= J0 and isochoric stretches above l0.
///
/// f is extended because it is infinite at x = Jm and undefined beyond, where an iterative solver may pass.
/// At 0.98 Jm the secant stiffness is 50 times that at rest and the tangent grows with 2500 / Jm: a state in
/// equilibrium hardly gets there, and what does is driven back. For small x the law is neo-Hookean, which it
/// becomes as Jm grows.
///
/// Source:   Ogden 1972; Gent, A new constitutive relation for rubber, Rubber Chem. Technol. 69, 1996;
/// Stomakhin, Howes, Schroeder, Teran, Energetically consistent invertible elasticity,
///           SCA 2012.
/// Departs:  there the energy is extended along principal stretches with a sign, which jumps from one stretch
///           to another when two are equal; here in J and l^2, smooth everywhere and without a singular value
///           decomposition.
/// Checked:  against finite differences, for J from -0.5 to 3 and at J = 0.
double distortional_energy(const Material& material, const Mat3& F);

/// First Piola-Kirchhoff stress of distortion P = dW/dF [Pa], for any F. PrintedNeoHookean: that of
/// NeoHookean.
///
///     neo-Hookean   P = mu g F + mu/2 g' tr C cof F                                        cof F = J F^-T
///     Mooney-Rivlin P = 2 F (c10 g I + c01 h (tr C I - C)) + (c10 g' tr C + c01 h' |cof F|^2) cof F
///     Gent          P = mu f' (2 g F + g' tr C cof F)
///     Ogden         P = 2 g F sum_i w_i N_i N_i^T + g' (sum_i w_i l_i^2) cof F
///                     + collapse' cof F,    w_i = sum_p 2 mu_p / alpha_p^2 s_p'(g l_i^2)
///
/// N_i are the eigenvectors of C. Nothing is divided by a stretch or by a difference of stretches: for equal
/// stretches the w_i are equal, and it does not matter which N_i the eigenvalue solver picks.
Mat3 distortional_stress(const Material& material, const Mat3& F);

/// Second Piola-Kirchhoff stress of distortion S = F^-1 P [Pa], symmetric, finite for any F.
///
///     S = A + b cof(C) / J   where   P = F A + b cof F
///
/// with A and b from above: no F is inverted. 1 / J, which is infinite at inversion, is
/// replaced by J / max(J^2, 0.05^2): exact for |J| >= 0.05, bounded and continuous within.
Mat3 distortional_second_stress(const Material& material, const Mat3& F);

/// First Piola-Kirchhoff stress P = F S [Pa], S the second; with a Prony series, of instantaneous loading.
///
///     P = dW/dF = distortional stress + kappa (J - 1) cof F,   W = distortional energy + kappa/2 (J - 1)^2
///
/// which for the neo-Hookean law, and J >= 0.05, is P = F S with
///
///     S = 2 dW/dC = mu J^(-2/3) (I - tr(C)/3 C^-1) + kappa J (J - 1) C^-1
///
/// Source:   Horton et al. 2007, section 3.3.
/// Departs:  the paper prints W with lambda (J - 1)^2, and S = lambda J (J - 1) C^-1 + mu J^(-2/3) I. That S
///           equals mu I at F = I, so a body at rest would be under stress, and it is not 2 dW/dC of the
///           printed W, nor of any W. We take the stress of the W above; PrintedNeoHookean gives the paper's.
/// Checked:  against finite differences of W.
Mat3 pk1_stress(const Material& material, const Mat3& F);

/// cof F = J F^-T without a division: column k is the area vector of the other two.
Mat3 cofactor(const Mat3& F);

/// det F below which powers of it are Taylor polynomials, of laws without a negative exponent: J0 above.
inline constexpr double smallest_J = 0.05;

/// The part of kappa that the converging scheme lets act at every point, ks = min(2/3 mu, kappa) [Pa]; the
/// rest acts on patches: see ProjectedKernel.
double pointwise_bulk_modulus(const Material& material);

/// sqrt((kappa + 4/3 mu) / density) and sqrt(mu / density) [m/s].
double pressure_wave_speed(const Material& material);
double shear_wave_speed(const Material& material);

/// Factors of a Prony series for one time step of length dt.
struct PronyStep {
  double c = 1.0;          ///< g_inf + sum_i g_i a_i: factor of the elastic stress in this step
  std::vector<double> e;   ///< [terms] exp(-dt / tau_i): what is left of the past
  std::vector<double> ga;  ///< [terms] g_i a_i, a_i = (1 - e_i) tau_i / dt
};

/// dt = 0: instantaneous, c = 1 and e = 1. dt = infinity: fully relaxed, c = g_inf and e = 0.
PronyStep prony_step(const Material& material, double dt);

/// The past of every integration point of a viscoelastic solid. Only distortion relaxes, not the volume:
///
///     S(t) = g_inf S0 + sum_i H_i,   dH_i/dt + H_i / tau_i = g_i dS0/dt
///     H_i^{n+1} = e_i H_i^n + g_i a_i (S0^{n+1} - S0^n)
///
/// S0 is the distortional second Piola-Kirchhoff stress without relaxation. The recursion is exact for an S0
/// that is linear in time over the step, and stable for any dt. Put into P = F S it leaves the elastic form,
///
///     P = c P0(F) + F K,   c = g_inf + sum_i g_i a_i,   K = sum_i (e_i H_i^n - g_i a_i S0^n),
///
/// with c and K constant during the step: the step's P is the derivative of c W + K : C / 2 by F, so a solver
/// that minimises an energy may keep doing so. Symmetric tensors are columns of xx, yy, zz, xy, yz, xz.
///
///     history.begin_step(dt);                          // any number of times: nothing is lost
///     P = history.step.c * distortional_stress(material, F) + F * history.K(q);    // in each iteration
///     history.accept(q, F);                            // once for every q: the step's end becomes the past
///
/// Starts at rest and relaxed. K and accept may be called at once for different q; both allocate nothing.
///
/// Source:   Simo 1987; Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.10; the recursion: Taylor,
///           Pister, Goudreau 1970.
/// Checked:  against relaxation after a step, a ramp's hereditary integral, and for dissipation over cycles.
struct ViscousHistory {
  Material material;
  PronyStep step;                               ///< the current one
  Eigen::Matrix<double, 6, Eigen::Dynamic> S0;  ///< [6xQ] at the end of the last accepted step [Pa]
  Eigen::MatrixXd H;                            ///< [6*terms x Q], likewise

  ViscousHistory(const Material& of, Index point_count);
  void begin_step(double dt) { step = prony_step(material, dt); }
  Mat3 K(Index q) const;
  void accept(Index q, const Mat3& F);
};

/// A published set of parameters.
struct Preset {
  std::string name;  ///< as typed: family name and year
  MaterialNumbers numbers;
};

/// The published sets, both of swine brain.
///
/// Source:   horton_2007: Horton, Wittek, Miller, Subject-Specific Biomechanical Simulation of Brain
///           Indentation Using a Meshless Method, MICCAI 2007, LNCS 4791.
///           miller_chinzei_2002: Miller, Chinzei, Mechanical properties of brain tissue in tension,
///           J. Biomechanics 35 (2002) 483-490.
/// Departs:  the tissue of 2002 is incompressible in the paper; nu 0.499 and 1000 kg/m^3 are our choice.
std::vector<Preset> material_presets();

/// Throws: UsageError if there is none of that name; it lists all names.
MaterialNumbers numbers_of_preset(const std::string& name);

}  // namespace dimple
