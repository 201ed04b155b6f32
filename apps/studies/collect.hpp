#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/studies/read_results.hpp"

namespace dimple {

/// Table with one row per case.
TextTable table_of(const std::vector<CollectedCase>& cases, const std::vector<double>& depths_mm);

/// HTML page with a picture per case, failures first. Pictures are not copied: they are at the path
/// `to_cases` and are loaded when visible.
std::string page_of(const std::vector<CollectedCase>& cases, const std::string& to_cases);

/// Copies force curves and pictures to `dataset` under the names of BIDS derivatives:
/// sub-01/sub-01_desc-indentation_force.tsv. Returns the number of cases with one. Throws UsageError: an id
/// does not consist of BIDS entities (sub-01, sub-01_ses-02); OutputError.
std::size_t write_bids(const std::vector<CollectedCase>& cases, const std::filesystem::path& out,
                       const std::filesystem::path& dataset);

}  // namespace dimple
