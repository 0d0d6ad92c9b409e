// Ranks that speak through c10d's TCPStore, a table of words that one process serves. Each call puts a rank's word
// there and waits for those of all others, so who is missing is known by name, which Gloo does not tell; and sums are
// made by each rank itself in one order. What crosses is little: fitness, decisions.
#include <torch/csrc/distributed/c10d/TCPStore.hpp>

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "core/error.hpp"
#include "ranks/ranks.hpp"

namespace giga {
namespace {

using Clock = std::chrono::steady_clock;
using Milliseconds = std::chrono::milliseconds;

constexpr const char *kFailure = "gigastep/failure", *kLeft = "gigastep/left";
constexpr Milliseconds kBeat{1000};
constexpr Milliseconds kRest{3000};  // what a rank that fails leaves the others to read its message
constexpr size_t kPiece = 4 << 20;   // the store takes values of up to 8 MB

std::vector<uint8_t> to_bytes(const std::string& text) { return {text.begin(), text.end()}; }

/// LibTorch puts pages of stack behind its messages.
std::string first_line(const std::string& message) { return message.substr(0, message.find('\n')); }

c10d::TCPStoreOptions options_of(int port, bool serves, Milliseconds timeout) {
  c10d::TCPStoreOptions options;
  options.port = static_cast<uint16_t>(port);
  options.isServer = serves;
  options.waitWorkers = false;
  options.timeout = timeout;
  return options;
}

/// Seconds for messages.
std::string seconds_of(Milliseconds time) { return cat(static_cast<double>(time.count()) / 1000, " s"); }

class StoreRanks final : public Ranks {
 public:
  StoreRanks(const RankPlace& place, const RankPatience& patience)
      : Ranks(place.rank, place.size),
        place_(place),
        patience_(patience),
        serves_(!place.served && place.rank == 0),
        heard_(static_cast<size_t>(place.size)),
        heard_outside_(static_cast<size_t>(place.size)) {
    store_ =
        reach([&] { return std::make_unique<c10d::TCPStore>(place.host, options_of(place.port, serves_, wait())); });
    beats_ = reach([&] { return std::make_unique<c10d::TCPStore>(place.host, options_of(place.port, false, wait())); });
    try {
      heart_ = std::thread([this] { beat(); });
      guard_ = std::thread([this] { guard(); });
      barrier();
    } catch (...) {
      still();
      throw;
    }
  }
  ~StoreRanks() override { still(); }

  std::vector<std::string> gather(const std::string& mine) override {
    const int64_t call = calls_++;
    return reach([&] {
      post(key(call, rank()), mine);
      std::vector<std::string> all;
      const Clock::time_point begin = Clock::now();
      for (int r = 0; r < size(); ++r) {
        if (r != rank()) wait_for(call, r, begin);
        all.push_back(r == rank() ? mine : read(key(call, r)));
      }
      // Whoever is in this call has read the words of the one before.
      if (call > 0) clear(key(call - 1, rank()));
      return all;
    });
  }

  void begin_outside(OutsideWait wait) override {
    const std::lock_guard lock(mutex_);
    missing_.clear();
    waited_since_ = Clock::now();
    begun_ = -1;
    outside_ = std::move(wait);
  }

  void end_outside() override {
    const std::lock_guard lock(mutex_);
    outside_.reset();
    if (!missing_.empty()) throw Error(missing_);
  }

  void report_failure(const std::string& message) noexcept override {
    try {
      store_->compareSet(word(kFailure), to_bytes(""), to_bytes(cat("rank ", rank(), " has failed: ", message)));
      if (serves_) std::this_thread::sleep_for(kRest);
    } catch (const std::exception&) {  // the store is gone: the others notice that by themselves
    }
  }

  void leave() override {
    barrier();
    reach([&] {
      store_->add(word(kLeft), 1);
      const Clock::time_point end = Clock::now() + kRest;
      while (serves_ && store_->add(word(kLeft), 0) < size() && Clock::now() < end)
        std::this_thread::sleep_for(Milliseconds(2));
      return 0;
    });
  }

 private:
  Milliseconds wait() const { return patience_.answer; }
  std::string word(const std::string& name) const { return cat(name, "/", place_.attempt); }
  std::string key(int64_t call, int rank) const { return word(cat("gigastep/call/", call, "/", rank)); }
  std::string life(int rank) const { return word(cat("gigastep/alive/", rank)); }
  std::string part(int rank) const { return word(cat("gigastep/begun/", rank)); }

  /// Calls of the store, whose errors say little.
  template <class F>
  auto reach(F&& f) -> decltype(f()) {
    try {
      return f();
    } catch (const c10::Error& e) {
      throw Error(lost(e));
    }
  }
  std::string lost(const c10::Error& e) const {
    return cat("rank ", rank(), " of ", size(), " cannot reach the store at ", place_.host, ":", place_.port, ", so ",
               who_serves(), " is missing: ", first_line(e.what_without_backtrace()));
  }
  const char* who_serves() const { return place_.served ? "the process that started the ranks" : "rank 0"; }

  // The first piece comes last: once it is there, all are. It begins with the size of the whole.
  void post(const std::string& name, const std::string& text) {
    for (size_t k = 1; k * kPiece < text.size(); ++k)
      store_->set(cat(name, "/", k), to_bytes(text.substr(k * kPiece, kPiece)));
    store_->set(name, to_bytes(cat(text.size(), ":") + text.substr(0, kPiece)));
    posted_pieces_ = {posted_pieces_.second, (text.size() + kPiece - 1) / kPiece};
  }
  std::string read(const std::string& name) {
    const std::vector<uint8_t> first = store_->get(name);
    std::string text(first.begin(), first.end());
    const size_t colon = text.find(':'), size = std::stoull(text.substr(0, colon));
    text.erase(0, colon + 1);
    for (size_t k = 1; k * kPiece < size; ++k) {
      const std::vector<uint8_t> piece = store_->get(cat(name, "/", k));
      text.append(piece.begin(), piece.end());
    }
    GIGA_CHECK(text.size() == size, text.size(), " bytes, not ", size);
    return text;
  }
  void clear(const std::string& name) {
    store_->deleteKey(name);
    for (size_t k = 1; k < posted_pieces_.first; ++k) store_->deleteKey(cat(name, "/", k));
  }

  void wait_for(int64_t call, int r, Clock::time_point begin) {
    Clock::time_point looked = Clock::now();
    while (!store_->check({key(call, r)})) {
      // A sixteenth of what it has waited so far.
      const auto waited = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - begin);
      std::this_thread::sleep_for(
          std::clamp(waited / 16, std::chrono::microseconds(20), std::chrono::microseconds(1000)));
      const Clock::time_point now = Clock::now();
      if (now - looked < kBeat / 4) continue;
      looked = now;
      expect_no_failure(*store_);
      check_alive(*store_, heard_, r, now);
      if (now - begin < patience_.answer) continue;
      fail(*store_,
           cat("rank ", r, " of ", size(), heard(r) ? " lives, but hangs: no answer within " : " did not come within ",
               seconds_of(patience_.answer)));
    }
  }
  std::string message_of_failure(c10d::TCPStore& store) {
    const std::vector<uint8_t> text = store.get(word(kFailure));
    return {text.begin(), text.end()};
  }
  void expect_no_failure(c10d::TCPStore& store) {
    if (store.check({word(kFailure)})) throw Error(message_of_failure(store));
  }
  /// The rank that is silent is told too, should it wake up again.
  [[noreturn]] void fail(c10d::TCPStore& store, const std::string& message) {
    store.compareSet(word(kFailure), to_bytes(""), to_bytes(message));
    throw Error(message_of_failure(store));
  }

  struct Heard {
    int64_t beats = 0;
    Clock::time_point at, looked;  // when they were counted first, last
  };
  void check_alive(c10d::TCPStore& store, std::vector<Heard>& heard, int r, Clock::time_point now) {
    Heard& last = heard[static_cast<size_t>(r)];
    const int64_t beats = store.add(life(r), 0);
    // Nobody looks between two calls: the first look of a call starts the clock.
    if (last.beats != beats || now - last.looked > 4 * kBeat) last = {beats, now, now};
    last.looked = now;
    if (beats == 0 || now - last.at < patience_.silence) return;
    fail(store, cat("rank ", r, " of ", size(), " has not been heard of for ", seconds_of(patience_.silence),
                    ": it is dead, stopped or cut off"));
  }
  bool heard(int r) const { return heard_[static_cast<size_t>(r)].beats > 0; }

  void beat() {
    std::unique_lock lock(mutex_);
    bool lost_store = false;
    do {
      try {
        if (!lost_store) beats_->add(life(rank()), 1);
        if (outside_ && missing_.empty()) look_outside();
      } catch (const c10::Error& e) {  // a call of the main thread will tell, unless that waits outside
        lost_store = true;
        if (outside_ && missing_.empty()) give_up(lost(e));
      } catch (const Error& e) {
        give_up(e.what());
      }
      if (outside_ && !missing_.empty() && Clock::now() - gave_up_at_ > patience_.giving_up) end_process();
      if (!lost_store || outside_) ++beaten_;  // who has lost the store calls it no more
    } while (!wake_.wait_for(lock, kBeat, [this] { return over_; }));
  }

  // ---- The wait elsewhere, on the heart's thread -----------------------------------------------------------------

  void look_outside() {
    const Clock::time_point now = Clock::now();
    expect_no_failure(*beats_);
    for (int r = 0; r < size(); ++r)
      if (r != rank()) check_alive(*beats_, heard_outside_, r, now);
    int64_t begun = 0;
    try {
      begun = outside_->begun();
    } catch (const Error& e) {
      fail(*beats_, cat("rank ", rank(), " has failed: ", e.what()));
    }
    if (begun != begun_) {
      begun_ = begun;
      waited_since_ = now;
      beats_->set(part(rank()), to_bytes(std::to_string(begun)));
    }
    if (now - waited_since_ >= patience_.answer) fail(*beats_, who_hangs());
  }
  /// The rank that has begun least.
  std::string who_hangs() {
    int behind = -1;
    int64_t least = begun_;
    for (int r = 0; r < size(); ++r) {
      int64_t begun = 0;
      if (beats_->check({part(r)})) {
        const std::vector<uint8_t> text = beats_->get(part(r));
        begun = std::stoll(std::string(text.begin(), text.end()));
      }
      if (begun < least) {
        least = begun;
        behind = r;
      }
    }
    const std::string within = cat("no answer within ", seconds_of(patience_.answer));
    if (behind < 0)
      return cat("all ", size(), " ranks live, but rank ", rank(), " waits for a sum over them: ", within);
    return cat("rank ", behind, " of ", size(), " lives, but hangs: it has begun ", least, " sums and rank ", rank(),
               " ", begun_, ", ", within);
  }
  void give_up(const std::string& message) {
    missing_ = message;
    {
      const std::lock_guard lock(guard_mutex_);
      gave_up_because_ = message;
    }
    gave_up_at_ = Clock::now();
    outside_->give_up();
  }
  [[noreturn]] void end_process() {
    std::cerr << "gigastep: rank " << rank() << ": " << missing_ << std::endl;
    std::_Exit(1);
  }

  void still() {
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
    }
    wake_.notify_one();
    if (heart_.joinable()) heart_.join();
    {
      const std::lock_guard lock(guard_mutex_);
      heart_is_still_ = true;
    }
    guard_wake_.notify_one();
    if (guard_.joinable()) guard_.join();
  }

  // ---- A store that does not answer ----------------------------------------------------------------------------

  /// Calls of the store know no end where its machine is cut off, or its process stopped: then neither the heart nor
  /// the main thread comes back. So this thread, which calls nobody, ends the process. It counts its own looks, so that
  /// all may be stopped and go on again together.
  void guard() {
    std::unique_lock lock(guard_mutex_);
    int64_t seen = 0;
    Milliseconds silent{0};
    Clock::time_point looked = Clock::now();
    while (!guard_wake_.wait_for(lock, kBeat, [this] { return heart_is_still_; })) {
      const Clock::time_point now = Clock::now();
      const bool slept = now - std::exchange(looked, now) > 4 * kBeat;
      silent = slept || seen != beaten_ ? Milliseconds{0} : silent + kBeat;
      seen = beaten_;
      if (silent < patience_.silence + patience_.giving_up) continue;
      const std::string why = cat("no answer from the store at ", place_.host, ":", place_.port, " for ",
                                  seconds_of(silent), ": ", who_serves(), " is dead, stopped or cut off");
      std::cerr << "gigastep: rank " << rank() << ": " << (gave_up_because_.empty() ? why : gave_up_because_)
                << std::endl;
      std::_Exit(1);
    }
  }

  const RankPlace place_;
  const RankPatience patience_;
  const bool serves_;
  std::unique_ptr<c10d::TCPStore> store_, beats_;  // the second is the heart's
  int64_t calls_ = 0;
  std::pair<size_t, size_t> posted_pieces_{1, 1};  // of the call before, of the latest
  std::vector<Heard> heard_;                       // [size] signs of life
  std::mutex mutex_;                               // of what follows
  std::condition_variable wake_;
  bool over_ = false;
  std::optional<OutsideWait> outside_;  // none: this rank waits nowhere else
  std::vector<Heard> heard_outside_;    // [size] signs of life, as the heart sees them
  Clock::time_point waited_since_, gave_up_at_;
  int64_t begun_ = -1;
  std::string missing_;  // why it gave up; empty: it has not
  std::thread heart_;
  std::atomic<int64_t> beaten_ = 0;  // rounds of the heart that came to an end
  std::mutex guard_mutex_;
  std::condition_variable guard_wake_;
  bool heart_is_still_ = false;
  std::string gave_up_because_;  // of `missing_`, whose mutex the heart may hold for ever
  std::thread guard_;
};

}  // namespace

std::unique_ptr<Ranks> join_ranks(const RankPlace& place, const RankPatience& patience) {
  return std::make_unique<StoreRanks>(place, patience);
}

struct RankServer::Store {
  c10d::TCPStore store{"127.0.0.1", options_of(0, true, kRest)};
};

RankServer::RankServer() : store_(std::make_unique<Store>()) {}
RankServer::~RankServer() = default;

int RankServer::port() const { return store_->store.getPort(); }

void RankServer::report_failure(const std::string& message) noexcept {
  try {
    store_->store.compareSet(cat(kFailure, "/0"), to_bytes(""), to_bytes(message));
  } catch (const std::exception&) {  // the ranks notice the end of the store by themselves
  }
}

}  // namespace giga
