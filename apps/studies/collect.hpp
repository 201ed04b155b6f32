#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/studies/read_results.hpp"

namespace dimple {

/// One row a case.
TextTable table_of(const std::vector<CollectedCase>& cases, const std::vector<double>& depths_mm);

/// One HTML page with a picture a case, failures first. The pictures stay where they are, `to_cases` away,
/// and are marked to be loaded when they come in sight.
std::string page_of(const std::vector<CollectedCase>& cases, const std::string& to_cases);

/// Force curves and pictures once more, in `dataset`, under the names of BIDS derivatives:
/// sub-01/sub-01_desc-indentation_force.tsv. Returns how many cases have one. Throws UsageError: an id is not
/// made of BIDS entities (sub-01, sub-01_ses-02); OutputError.
std::size_t write_bids(const std::vector<CollectedCase>& cases, const std::filesystem::path& out,
                       const std::filesystem::path& dataset);

}  // namespace dimple
