// Whole files: reading one, and writing one so that a crash leaves the old file or the new one, never a part of it.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace giga {

/// All bytes of a file; throws InputError where there is none or it cannot be read.
std::string read_file(const std::filesystem::path& path);

/// Is there something that is no file of its own: /dev/stdout, a pipe? write_file adds to it.
bool is_written_in_place(const std::filesystem::path& path);

/// Writes a temporary file beside `path`, flushes it to the disk and renames it; then the folder is flushed. Every file
/// that must survive a crash goes through here. Of a link the file that it leads to is written; one that leads nowhere
/// is replaced.
void write_file(const std::filesystem::path& path, std::string_view bytes);

/// Makes the folders in which a file is to lie; throws InputError where that fails.
void make_folder_of(const std::filesystem::path& file);

/// Writes a text that is the result of a command: to a file, which is made with its folders; `-`: to the standard
/// output.
void write_or_print(const std::string& destination, std::string_view text);

/// Without "." and "..", and without a slash at its end.
std::filesystem::path absolute_path(const std::filesystem::path& path);
/// The last part of its absolute path.
std::string name_of_folder(const std::filesystem::path& folder);

/// Whether a file is called as write_file calls what it has not finished: "config.yaml.4711.tmp".
bool is_unfinished(const std::filesystem::path& file);
/// Removes what interrupted calls of write_file left in a folder, and not what another process is writing there;
/// returns how many.
int remove_temporaries(const std::filesystem::path& folder);

}  // namespace giga
