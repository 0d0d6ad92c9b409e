// gigastep picture: the paths of a replay's games as a picture, or a game as a film.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <optional>

#include "apps/commands.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "core/error.hpp"
#include "io/files.hpp"
#include "watch/film.hpp"
#include "watch/trajectories.hpp"

namespace giga {
namespace {
namespace fs = std::filesystem;

struct PictureOptions {
  std::string replay, out, film;
  std::optional<int> episode;
  FilmOptions how;
  std::string of_film_alone;  ///< an option that was given and means nothing without --film
};

/// All episodes, or the one that was asked for.
void write_picture(Replay replay, const PictureOptions& o) {
  const fs::path out = o.out;
  if (o.episode) replay.episodes = {episode_of(replay, *o.episode)};
  write_output(out, out.extension() == ".svg" ? trajectories_svg(replay, o.episode.value_or(0))
                                              : encode_png(trajectories_pixels(replay)));
}

/// Before anything is read or drawn.
void expect_known_endings(const PictureOptions& o) {
  if (o.out.empty() && o.film.empty()) throw InputError("--out or --film says what to write");
  const fs::path picture = fs::path(o.out).extension(), film = fs::path(o.film).extension();
  if (!o.out.empty() && picture != ".svg" && picture != ".png")
    throw InputError(cat("--out ", o.out, ": the ending says what is written: .svg or .png"));
  if (!film.empty() && film != ".gif")
    throw InputError(cat("--film ", o.film, ": a name that ends in .gif, or of a folder for a sequence of PNG files"));
  if (o.film.empty() && !o.of_film_alone.empty())
    throw InputError(o.of_film_alone + " is of a film: --film is missing");
}

std::string frame_name(int k) {
  char name[32];
  std::snprintf(name, sizeof name, "%05d.png", k);
  return name;
}

/// Ten steps are a second.
void write_film(const Replay& replay, const PictureOptions& o) {
  const fs::path out = o.film;
  const int length = film_length(replay, o.how);
  if (out.extension() == ".gif") {
    const Canvas first = film_picture(replay, o.how, 0);
    Gif gif(first.width(), first.height(), 10 * o.how.every);
    for (int k = 0; k < length; ++k) gif.add(film_picture(replay, o.how, k));
    return write_output(out, gif.finish());
  }
  // They would become the end of a video.
  if (const fs::path behind = out / frame_name(length); fs::exists(behind))
    throw InputError(
        cat("--film ", o.film, ": ", behind.string(), " is of a longer film; name another folder, or empty it"));
  for (int k = 0; k < length; ++k) write_output(out / frame_name(k), encode_png(film_picture(replay, o.how, k)));
}

void make(const PictureOptions& o) {
  expect_known_endings(o);
  const Replay replay = decode_replay(read_file(o.replay), o.replay);
  if (replay.episodes.empty()) throw InputError(o.replay + " has no episodes");
  if (!o.out.empty()) {
    write_picture(replay, o);
    std::cout << o.out << std::endl;
  }
  if (!o.film.empty()) {
    write_film(replay, o);
    std::cout << o.film << ": " << film_length(replay, o.how) << " pictures" << std::endl;
  }
}

}  // namespace

void add_picture_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("picture", "draw the games of a replay: their paths, or a film");
  auto options = std::make_shared<PictureOptions>();
  command->add_option("REPLAY", options->replay, "file that `gigastep record` wrote")->required()->type_name("");
  command->add_option("--out", options->out, "the paths of all episodes, or of the one of --episode, as .svg or .png")
      ->check(output(Output::file))
      ->type_name("FILE");
  command->add_option("--film", options->film, "one episode as .gif, or a folder of PNG files")
      ->transform([](std::string text) {
        while (text.size() > 1 && text.ends_with('/')) text.pop_back();  // as shells complete folders
        return text;
      })
      ->check([](const std::string& text) {
        std::string path = text;
        return output(text.ends_with(".gif") ? Output::file : Output::folder)(path);
      })
      ->type_name("FILE|DIR");
  command->add_option("--episode", options->episode, "counted from 0; default: of a film 0, of --out all")
      ->transform(value_of<int>(at_least(0)))
      ->type_name("K");
  const CLI::Option* size =
      command->add_option("--size", options->how.side, "of the film: pixels of the longer side of the world")
          ->transform(value_of<int>(range(50, 4000)))
          ->capture_default_str()
          ->type_name("N");
  const CLI::Option* every =
      command->add_option("--every", options->how.every, "of the film: steps from one picture to the next")
          ->transform(value_of<int>(range(1, 1000)))
          ->capture_default_str()
          ->type_name("N");
  command->footer(
      "Examples:\n"
      "  gigastep picture game.replay --out trajectories.svg\n"
      "  gigastep picture game.replay --out one.png --episode 3\n"
      "  gigastep picture game.replay --film game.gif --episode 2\n"
      "  gigastep picture game.replay --film frames --every 1 --size 1080");
  command->callback([options, size, every, &dispatch] {
    options->how.episode = options->episode.value_or(0);
    for (const CLI::Option* option : {size, every})
      if (option->count() > 0) options->of_film_alone = option->get_name();
    dispatch.run = [options] { make(*options); };
  });
}

}  // namespace giga
