#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apps/run/model_files.hpp"
#include "apps/scene/scene.hpp"

namespace dimple {

/// Identity of a run: all that decides its bits.
struct RunIdentity {
  std::string version;                         ///< of the program
  std::map<std::string, std::string> options;  ///< as option_values()
  std::string input_sha256;                    ///< of the image, or of the model's files
};

/// State of a run that was stopped, as written to the disk.
struct Checkpoint {
  RunIdentity run;
  std::string model_sha256;
  std::vector<double> frame_time_s;           ///< of the frames written before it
  double solve_wall_s = 0, write_wall_s = 0;  ///< spent so far
  MarchState state;
};

/// Writes CBOR (RFC 8949) with its SHA-256 in hexadecimal at the end, by write_file(). Throws OutputError.
void write_checkpoint(const std::filesystem::path& file, const Checkpoint& checkpoint);
/// Throws InputError: there is no file, or write_checkpoint() has not made it bit for bit.
Checkpoint read_checkpoint(const std::filesystem::path& file);

/// Code of the error of require_same_run().
inline constexpr const char* other_run = "other-run";
/// Throws UsageError, with the difference, unless a run of identity `now` would continue `before`.
void require_same_run(const RunIdentity& before, const RunIdentity& now);

/// SHA-256 of the model before supports are found: nodes, points, sets, tool.
std::string sha256_of_model(const Discretisation& places, const Scheme& scheme);

}  // namespace dimple
