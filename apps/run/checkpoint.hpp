#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apps/run/model_files.hpp"
#include "apps/scene/scene.hpp"

namespace dimple {

/// What decides every bit of a run.
struct RunIdentity {
  std::string version;                         ///< of the program
  std::map<std::string, std::string> options;  ///< as option_values()
  std::string input_sha256;                    ///< of the image, or of the model's files
};

/// A run that was stopped half-way, as it lies on the disk.
struct Checkpoint {
  RunIdentity run;
  std::string model_sha256;
  std::vector<double> frame_time_s;           ///< of the frames written before it
  double solve_wall_s = 0, write_wall_s = 0;  ///< spent so far
  MarchState state;
};

/// In CBOR (RFC 8949) with its SHA-256 in hexadecimal behind it, through write_file(). Throws OutputError.
void write_checkpoint(const std::filesystem::path& file, const Checkpoint& checkpoint);
/// Throws InputError: no file, or not one that write_checkpoint() has made, bit for bit.
Checkpoint read_checkpoint(const std::filesystem::path& file);

/// Code of what require_same_run() throws.
inline constexpr const char* other_run = "other-run";
/// Throws UsageError, naming what differs, unless a run of identity `now` would give what `before` has begun.
void require_same_run(const RunIdentity& before, const RunIdentity& now);

/// SHA-256 of what a model is made of, before supports are found: nodes, points, sets, tool.
std::string sha256_of_model(const Discretisation& places, const Scheme& scheme);

}  // namespace dimple
