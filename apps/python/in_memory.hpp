#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {

/// Content of pydimple.Model.
struct ModelInMemory {
  /// Nodes, scheme, and data for to_surface(); a solution adds what depends on the tissues.
  Model model;
  std::map<std::string, int> label_names;
  std::map<std::string, std::string> provenance;
  std::vector<std::string> warnings;
  std::string report_json;
  std::shared_ptr<const Origin> origin;  // for the error bounds of its force

  // Interpolation to the vertices of the surface, made at the first call.
  const Interpolation& to_surface() const {
    std::call_once(made_, [this] { to_surface_ = surface_interpolation(model); });
    return to_surface_;
  }
  const Interpolation& to_nodes() const {
    std::call_once(made_for_nodes_, [this] { to_nodes_ = node_interpolation(model); });
    return to_nodes_;
  }

 private:
  mutable std::once_flag made_, made_for_nodes_;
  mutable Interpolation to_surface_, to_nodes_;
};
using ModelHolder = std::shared_ptr<ModelInMemory>;

/// Content of pydimple.Result.
struct Solved {
  std::vector<ForceSample> force;
  ErrorBounds error_bounds;
  std::vector<std::string> warnings;
  std::string summary_json;
  ModelHolder model;
  std::vector<double> frame_time, frame_depth, frame_u;  // [F], [F], [F x N x 3]
};

/// Bytes of a model, or of a result without its model, and back, without loss. Throws InputError: bytes of
/// another version of the program, or damaged ones.
std::vector<std::uint8_t> bytes_of(const ModelInMemory& model);
ModelHolder model_of(const std::vector<std::uint8_t>& bytes);
std::vector<std::uint8_t> bytes_of(const Solved& solved);
std::unique_ptr<Solved> solved_of(const std::vector<std::uint8_t>& bytes, ModelHolder model);

}  // namespace dimple
