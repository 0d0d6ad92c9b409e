// Files and folders that a command writes at its end: told at once where they cannot be, and made with their folders.
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <string_view>

namespace giga {

/// What the value of an option stands for: a file, a file or `-` for the standard output, what the names of files begin
/// with, or a folder.
enum class Output : uint8_t { file, file_or_stdout, stem, folder };

/// For CLI::Option::check: refuses what cannot be written, before any work starts.
CLI::Validator output(Output kind);
/// The same of a value that CLI does not check, as that of a default; throws InputError. `advice`: what helps.
void expect_output(Output kind, const std::filesystem::path& path, const std::string& advice);

/// Whether a folder is there and has something in it, but for the lock of a process.
bool holds_files(const std::filesystem::path& folder);

/// Writes a file, and makes the folders in which it lies.
void write_output(const std::filesystem::path& file, std::string_view bytes);

}  // namespace giga
