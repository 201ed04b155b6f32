#include "apps/run/checkpoint.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "apps/run/archive.hpp"
#include "io/error.hpp"
#include "io/file.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr const char* format = "dimple checkpoint 20";
constexpr std::size_t digest_length = 64;  // SHA-256 in hexadecimal, at the end

}  // namespace

template <class Archive, Like<History> T>
void members(Archive& io, T& history) {
  auto& [force, energy, evaluations, extra_evaluations, dt_stable_first, dt_first, dt_smallest, J_min,
         inverted, residual, interrupted, preload_displacement, carried, penetration, contact_area,
         contact_pressure, contact_samples, penetration_at, no_slip_area, contact_dissipation, folds, walls,
         on_walls, momentum_error, guards, retries] = history;
  io(force, energy, evaluations, extra_evaluations, dt_stable_first, dt_first, dt_smallest, J_min, inverted,
     residual, interrupted, preload_displacement, carried, penetration, contact_area, contact_pressure,
     contact_samples, penetration_at, no_slip_area, contact_dissipation, folds, walls, on_walls,
     momentum_error, guards, retries);
}

template <class Archive, Like<RigidContact::ContactSummary> T>
void members(Archive& io, T& contact_summary) {
  auto& [force, moment, area, no_slip, pressure, samples, penetration, dissipation] = contact_summary;
  io(force, moment, area, no_slip, pressure, samples, penetration, dissipation);
}

template <class Archive, Like<FoldContact::Audit> T>
void members(Archive& io, T& audit) {
  auto& [penetration, slid, area, force, in_contact] = audit;
  io(penetration, slid, area, force, in_contact);
}

template <class Archive, Like<Report> T>
void members(Archive& io, T& report) {
  auto& [fact, where, why, remedy, code] = report;
  io(fact, where, why, remedy, code);
}

template <class Archive, Like<Finding> T>
void members(Archive& io, T& finding) {
  auto& [report, worst, is_minor] = finding;
  io(report, worst, is_minor);
}

template <class Archive, Like<Retry> T>
void members(Archive& io, T& retry) {
  auto& [code, depth, what] = retry;
  io(code, depth, what);
}

template <class Archive, Like<Predictor::Point> T>
void members(Archive& io, T& point) {
  auto& [at, u, lambda] = point;
  io(at, u, lambda);
}

template <class Archive, Like<EquilibriumState> T>
void members(Archive& io, T& state) {
  auto& [u, lambda] = state;
  io(u, lambda);
}

template <class Archive, Like<Account> T>
void members(Archive& io, T& account) {
  auto& [depth_before, force_before, external, dissipated, next_sample, next_energy, largest_reaction,
         largest_external] = account;
  io(depth_before, force_before, external, dissipated, next_sample, next_energy, largest_reaction,
     largest_external);
}

template <class Archive, Like<MarchState> T>
void members(Archive& io, T& state) {
  auto& [frame, step, steps, dt, dt_before, dt_stable, depth, account, safety, longest, refused, looked,
         depths, forces, u, v, path, past, step_of_scene, step_start, least_reactions, history] = state;
  io(frame, step, steps, dt, dt_before, dt_stable, depth, account, safety, longest, refused, looked, depths,
     forces, u, v, path, past, step_of_scene, step_start, least_reactions, history);
}

template <class Archive, Like<Checkpoint> T>
void members(Archive& io, T& checkpoint) {
  io(checkpoint.run.version, checkpoint.run.options, checkpoint.run.input_sha256, checkpoint.model_sha256,
     checkpoint.frame_time_s, checkpoint.solve_wall_s, checkpoint.write_wall_s, checkpoint.state);
}

void write_checkpoint(const fs::path& file, const Checkpoint& checkpoint) {
  const auto text_of = [](const std::vector<std::uint8_t>& bytes) {
    return std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  };
  std::vector<std::uint8_t> bytes = to_bytes(format, checkpoint);
  const std::string digest = sha256(text_of(bytes));
  bytes.insert(bytes.end(), digest.begin(), digest.end());
  write_file(file, text_of(bytes));
}

Checkpoint read_checkpoint(const fs::path& file) {
  const auto refuse = [&](const std::string& why) {
    throw InputError({.fact = fmt::format("{} cannot be read", file.string()),
                      .where = "--resume",
                      .why = why,
                      .remedy = "start the run again with --force"});
  };
  std::string content = read_file(file);
  const std::size_t length = content.size() - std::min(content.size(), digest_length);
  const std::string digest = content.substr(length);
  content.resize(length);
  if (sha256(content) != digest)
    refuse("it is damaged, or no checkpoint of this version: its checksum differs");
  Checkpoint checkpoint;
  try {
    from_bytes(format, content, checkpoint);
  } catch (const std::exception& error) {
    refuse(fmt::format("it is no checkpoint of this version: {}", error.what()));
  }
  return checkpoint;
}

void require_same_run(const RunIdentity& before, const RunIdentity& now) {
  std::string differs;
  if (before.version != now.version)
    differs = fmt::format("the program is version {} now, and was {}", now.version, before.version);
  else if (before.input_sha256 != now.input_sha256)
    differs = "the image or model differs or has changed";
  for (const auto& [key, value] : now.options) {
    const auto found = before.options.find(key);
    const std::string was = found == before.options.end() ? "not set" : found->second;
    if (differs.empty() && was != value) differs = fmt::format("{} is {} now, and was {}", key, value, was);
  }
  for (const auto& [key, value] : before.options)
    if (differs.empty() && now.options.count(key) == 0)
      differs = fmt::format("{} is not set now, and was {}", key, value);
  if (!differs.empty())
    throw UsageError({.fact = "the run in that folder differs: " + differs,
                      .where = "--resume",
                      .why = "the result would belong to neither run",
                      .remedy = "give the same image and options, or start again with --force",
                      .code = other_run});
}

std::string sha256_of_model(const Discretisation& m, const Scheme& scheme) {
  std::string bytes;
  const auto add = [&](const void* data, std::size_t size) {
    const std::uint64_t count = size;
    bytes.append(reinterpret_cast<const char*>(&count), sizeof count);
    if (size > 0) bytes.append(static_cast<const char*>(data), size);
  };
  const auto matrix = [&](const auto& values) {
    add(values.data(), sizeof(*values.data()) * static_cast<std::size_t>(values.size()));
  };
  matrix(m.X);
  matrix(m.spacing);
  matrix(m.point);
  matrix(m.volume);
  matrix(m.second_moments);
  matrix(m.label);
  for (const auto* set : {&m.base, &m.bonded_patch}) add(set->data(), sizeof(Index) * set->size());
  matrix(m.tool.centre);
  matrix(m.tool.approach);
  add(&m.tool.radius, sizeof m.tool.radius);
  matrix(m.axes);
  matrix(m.surface.vertex_mm);
  matrix(m.surface.triangles);
  add(scheme.name.data(), scheme.name.size());
  const std::string support =
      fmt::format("{} {}", scheme.support.radius_factor, scheme.support.interpolation);
  add(support.data(), support.size());
  return sha256(bytes);
}

}  // namespace dimple
