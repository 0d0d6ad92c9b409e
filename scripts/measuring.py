"""What scripts/measure and scripts/reproduce have in common: jobs, which are calls of gigastep; rows of JSON about them;
workers that do what is left on the devices that there are; the text of tables. First: use_folder()."""

import concurrent.futures
import contextlib
import datetime
import json
import os
import queue
import re
import shlex
import shutil
import signal
import statistics
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TINY = os.environ.get("GIGASTEP_MEASURE_TINY", "") not in ("", "0")
HOME = OUT = None  # where rows, logs and checkpoints are kept, and where new rows go: use_folder()
BUILD = Path(os.environ.get("BUILD", "build/release"))
SEEDS = (1, 2) if TINY else (1, 2, 3, 4, 5)
EPISODES = 32 if TINY else 1024
EVOLVING = ("openai_es", "snes", "des")
TINY_MAPPO = ("train.n_worlds=64", "train.total_agent_steps=6000", "mappo.n_minibatches=1", "eval.episodes=8")
TINY_EVOLUTION = ("population.population_size=4", "train.total_agent_steps=1500", "population.max_steps=20",
                  "opponents.pool_every_updates=1", "opponents.pool_size=1", "eval.episodes=8")


def use_folder(name):
    """Rows are in build/NAME, and new ones go there unless OUT says where."""
    global HOME, OUT
    HOME = Path(f"build/{name}_tiny" if TINY else f"build/{name}")
    OUT = Path(os.environ.get("OUT", HOME))


# --- Jobs -------------------------------------------------------------------------------------------------------------

@dataclass(frozen=True)
class Bench:
    """One call of `gigastep bench`."""
    piece: str
    words: str
    device: str  # cpu, cuda
    seconds: int = 30  # about what it takes
    few: int = 64  # worlds where everything is tried in small

    @property
    def key(self):
        return f"{self.piece}: {self.words}"

    def command(self):
        words = ["bench", *self.words.split()]
        if not TINY:
            return words
        small = {"train": "--set mappo.horizon=8 --set mappo.n_minibatches=1",
                 "es": "--set population.max_steps=8 --set population.episodes_per_member=4"}.get(words[1], "")
        if "--worlds" in words:
            at = words.index("--worlds")
            del words[at:at + 2]
        return [*words, "--worlds", str(self.few), "--steps", "1", "--repeats", "2", *small.split()]


def checkpoint_of(piece, what, seed):
    """Where the last checkpoint of a run is kept, if it is."""
    return HOME / "checkpoints" / (re.sub(r"[^A-Za-z0-9_]+", "_", f"{piece} {what} seed {seed}") + ".h5")


def commit_of(checkpoint):
    """The file beside it that names the commit of the program that trained it."""
    return checkpoint.with_suffix(".commit")


@dataclass(frozen=True)
class Run:
    """A learning run with one seed, and games of its last checkpoint against scripts."""
    piece: str
    what: str
    config: str
    seed: int
    settings: tuple
    opponents: tuple
    device: str
    seconds: int

    @property
    def key(self):
        return f"{self.piece}: {self.what}, seed {self.seed}"

    @property
    def checkpoint(self):
        return checkpoint_of(self.piece, self.what, self.seed)

    def command(self):
        words = ["train", f"configs/{self.config}.yaml", "--seed", str(self.seed)]
        small = TINY_EVOLUTION if self.config.startswith(EVOLVING) else TINY_MAPPO
        for setting in self.settings + (small if TINY else ()):
            words += ["--set", setting]
        return words


@dataclass(frozen=True)
class Duel:
    """Games of the last checkpoints of runs against each other, and against scripts: who wins, and ratings."""
    piece: str
    what: str
    seed: int
    of: tuple  # the runs
    device: str = "cuda"
    seconds: int = 10

    @property
    def key(self):
        return f"{self.piece}: {self.what}, seed {self.seed}"


def runs(piece, what, config, opponents, device, seconds, settings=(), seeds=SEEDS):
    return [Run(piece, what, config, seed, tuple(settings), opponents, device, seconds) for seed in seeds]


# --- Rows -------------------------------------------------------------------------------------------------------------

def read_rows(files):
    rows = []
    for file in files:
        for line in file.read_text().splitlines():
            if line.strip():
                rows.append(json.loads(line))
    return rows


def all_rows():
    """The rows of both folders, each once."""
    files = sorted({file.resolve() for folder in (HOME, OUT) for file in folder.glob("*.jsonl")})
    unique = {json.dumps(row, sort_keys=True): row for row in read_rows(files)}
    return list(unique.values())


def write_row(folder, row):
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / f"{row['piece']}.jsonl", "a") as file:
        file.write(json.dumps(row) + "\n")


def add_rows(files):
    """Takes over rows that are not known yet."""
    known = [json.dumps(row, sort_keys=True) for row in all_rows()]
    new = [row for row in read_rows(files) if json.dumps(row, sort_keys=True) not in known]
    for row in new:
        write_row(HOME, row)
    print(f"{len(new)} new rows in {HOME}")


# --- Measuring --------------------------------------------------------------------------------------------------------

class Failed(Exception):
    pass


class OutOfTime(Exception):
    pass


class Stopped(Exception):
    """By Ctrl-C or SIGTERM."""


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        pass
    return True


class Measuring:
    """One call: jobs on devices side by side, until all are done or the time is up."""

    def __init__(self, start, limit, jobs_per_gpu):
        self.deadline = start + limit
        self.jobs_per_gpu = jobs_per_gpu
        self.program = str(BUILD / "bin/gigastep")
        version = subprocess.run([self.program, "--version"], capture_output=True, text=True, check=True).stdout
        self.commit = re.search(r"\(commit ([^,)]+)", version)[1]
        self.lock = threading.Lock()
        self.failed = []
        self.stopping = False
        self.processes = set()

    def left(self, jobs):
        done = {row["key"] for row in all_rows() if row["commit"] == self.commit}
        return [job for job in jobs if job.key not in done]

    def call(self, words, log, slot):
        """Runs gigastep; gives its standard output and the seconds. All output goes to the log."""
        environment = dict(os.environ)
        if slot is not None:
            environment["CUDA_VISIBLE_DEVICES"] = slot
        command = [self.program, *words]
        with open(log, "a") as file:
            file.write("$ " + shlex.join(command) + "\n")
        start = time.monotonic()
        with self.lock:
            if self.stopping:
                raise Stopped()
            process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
            self.processes.add(process)
        try:
            output, errors = process.communicate(timeout=max(1.0, self.deadline - start))
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise OutOfTime() from None
        finally:
            with self.lock:
                self.processes.discard(process)
        with open(log, "a") as file:
            file.write(output + errors)
        if self.stopping:
            raise Stopped()
        if process.returncode != 0:
            raise Failed(f"exit code {process.returncode}, see {log}\n" + errors[-2000:])
        return output, time.monotonic() - start

    def stop(self):
        """Ends what runs; nothing more begins."""
        with self.lock:
            self.stopping = True
            for process in self.processes:
                process.terminate()

    @contextlib.contextmanager
    def folder(self, kind, log):
        """A folder for one job, which goes with it: runs are large, and the same command makes them again. Its learning
        curve stays beside the log."""
        folder = HOME / kind / f"{log.stem}_{os.getpid()}"
        try:
            yield folder
        finally:
            with contextlib.suppress(OSError):
                shutil.copy(folder / "metrics.csv", log.with_suffix(".csv"))
            shutil.rmtree(folder, ignore_errors=True)

    def remove_leftovers(self):
        """Folders of calls that were killed."""
        for folder in [*HOME.glob("runs/*_*"), *HOME.glob("exploits/*_*")]:
            pid = folder.name.rpartition("_")[2]
            if pid.isdigit() and not is_alive(int(pid)):
                shutil.rmtree(folder, ignore_errors=True)

    def begin_row(self, job, slot, words):
        """What every row says, of a command without its device; and the log of the job."""
        device = "cpu" if TINY else job.device
        log = HOME / "logs" / (re.sub(r"[^A-Za-z0-9_]+", "_", job.key) + ".log")
        log.parent.mkdir(parents=True, exist_ok=True)
        log.unlink(missing_ok=True)
        row = {"key": job.key, "piece": job.piece, "commit": self.commit, "device": device_name(device, slot),
               "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
               "command": command_text_of(words, device)}
        return row, log

    def has_left(self, checkpoint):
        """Whether a run of this commit has left it: rows name the commit of what they measure."""
        return checkpoint.exists() and commit_of(checkpoint).exists() and commit_of(checkpoint).read_text() == self.commit

    def keeps(self, job):
        """Whether the last checkpoint of a run is needed when its folder is gone."""
        return job.piece == "recurrent"

    def duel(self, job, slot, beside):
        """Each of the runs against the last of them, which plays both sides; ratings of all."""
        row, log = self.begin_row(job, slot, ["rate", *(str(run.checkpoint) for run in job.of)])
        *others, last = job.of
        row.update(what=job.what, seed=job.seed, beside=beside, last=last.what, duels={})
        device = "cpu" if TINY else job.device
        for other in others:
            text, _ = self.call(["eval", str(last.checkpoint), "--vs", str(other.checkpoint), "--both-sides", "--episodes",
                                 str(EPISODES), "--seed", str(job.seed), "--device", device, "--json", "-"], log, slot)
            row["duels"][other.what] = [{name: side[name] for name in ("team", "win_rate", "loss_rate")}
                                        for side in json.loads(text)["sides"]]
        text, row["seconds"] = self.call(
            ["rate", *(str(run.checkpoint) for run in job.of), "--scripted", "random,circle,pursuer", "--episodes",
             str(EPISODES), "--seed", str(job.seed), "--out", str(log.with_suffix("")), "--device", device, "--json", "-"],
            log, slot)
        rated = json.loads(text)
        names = [player["name"] for player in rated["players"] if player["kind"] == "checkpoint"]  # in their order
        row["ratings"] = {run.what: [r["rating"] for r in rated["ratings"] if r["player"] == name]
                          for run, name in zip(job.of, names, strict=True)}
        return row

    def measure(self, job, slot, beside):
        if isinstance(job, Duel):
            return self.duel(job, slot, beside)
        device = "cpu" if TINY else job.device
        row, log = self.begin_row(job, slot, job.command())
        if isinstance(job, Bench):
            text, row["seconds"] = self.call([*job.command(), "--device", device, "--json", "-"], log, slot)
            result = json.loads(text)
            row.update(kind=result["kind"], scenario=result["scenario"], results=result["results"])
            return row

        with self.folder("runs", log) as run:
            self.learn(job, slot, row, log, run, device)
        row["beside"] = beside
        return row

    def learn(self, job, slot, row, log, run, device):
        """Trains in a folder; the games of the last checkpoint go into the row."""
        _, row["seconds"] = self.call([*job.command(), "--device", device, "--run-dir", str(run), "--quiet"], log, slot)
        header, *_, last = (run / "metrics.csv").read_text().splitlines()
        figures = dict(zip(header.split(","), last.split(",")))
        row.update(what=job.what, seed=job.seed, agent_steps=int(float(figures["agent_steps"])),
                   run_seconds=float(figures["seconds"]), episodes=EPISODES, wins={})
        checkpoint = max((run / "checkpoints").glob("update_*.h5"))  # the last, not the best: nothing is chosen
        for opponent in job.opponents:
            measured = opponent == "circle"  # whom all games have
            text, _ = self.call(["eval", str(checkpoint), "--vs", opponent, "--episodes", str(EPISODES), "--seed",
                                 str(job.seed), *(["--information"] if measured else []), "--device", device, "--json",
                                 "-"], log, slot)
            sides = json.loads(text)["sides"]
            row["wins"][opponent] = [
                {name: side[name] for name in ("team", "win_rate", "loss_rate", "tie_rate", "mean_score",
                                               "mean_survivors")}
                for side in sides]
            if measured:
                known = {side["team"]: side["mutual_information"] for side in sides}
                row["mutual_information"] = [known.get(team) for team in (0, 1)]
        if self.keeps(job):
            job.checkpoint.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(checkpoint, job.checkpoint)
            commit_of(job.checkpoint).write_text(self.commit)

    def work(self, jobs, slot, beside):
        """A worker: takes jobs that end in time, until there are none."""
        while True:
            try:
                job = jobs.get_nowait()
            except queue.Empty:
                return
            if time.monotonic() + (1 if TINY else job.seconds * beside) > self.deadline:
                continue  # a shorter one may fit
            print(f"begins: {job.key}", flush=True)
            try:
                row = self.measure(job, slot, beside)
            except OutOfTime:
                print(f"stopped at the limit: {job.key}", flush=True)
            except Stopped:
                print(f"stopped: {job.key}", flush=True)
                return
            except Exception as error:  # whatever it is, the other jobs go on
                with self.lock:
                    self.failed.append(job.key)
                print(f"failed: {job.key}: {error}", flush=True)
            else:
                with self.lock:
                    write_row(OUT, row)
                print(f"measured in {row['seconds']:.0f} s: {job.key}", flush=True)

    def run(self, jobs):
        """Benchmarks have the machine for themselves; learning runs share the GPUs, and have the CPU one by one."""
        self.remove_leftovers()
        for kind in (Bench, Run, Duel):
            todo = queue.Queue()
            mine = [job for job in self.left(jobs) if isinstance(job, kind)]
            if kind is Duel:
                mine = [job for job in mine if all(self.has_left(run.checkpoint) for run in job.of)]
            for job in mine:
                todo.put(job)
            if not mine:
                continue
            slots = [None]
            if mine[0].device == "cuda" and not TINY:
                slots = gpus()[:1] if kind is Bench else gpus() * self.jobs_per_gpu
            slots = slots[:max(1, len(mine))]
            with concurrent.futures.ThreadPoolExecutor(len(slots)) as pool:
                workers = [pool.submit(self.work, todo, slot, slots.count(slot)) for slot in slots]
                try:
                    concurrent.futures.wait(workers)
                except BaseException:  # Ctrl-C, or SIGTERM (stoppable)
                    self.stop()
                    raise
            for worker in workers:
                worker.result()


def command_text_of(words, device):
    return shlex.join(["gigastep", *words, "--device", device])


def command_of(job):
    return command_text_of(job.command(), "cpu" if TINY else job.device)


def gpus():
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible:
        return visible.split(",")
    listed = subprocess.run(["nvidia-smi", "--query-gpu=index", "--format=csv,noheader"], capture_output=True, text=True)
    if listed.returncode != 0 or not listed.stdout.split():
        sys.exit(f"{Path(sys.argv[0]).name}: no GPU is visible here")
    return listed.stdout.split()


def device_name(device, slot):
    if device == "cpu":
        info = Path("/proc/cpuinfo").read_text()
        model = re.search(r"^model name\s*: (.*)$", info, re.M)
        return f"{model[1] if model else 'CPU'}, {len(os.sched_getaffinity(0))} cores"
    text = subprocess.run(["nvidia-smi", "-i", slot, "--query-gpu=name,driver_version", "--format=csv,noheader"],
                          capture_output=True, text=True, check=True).stdout
    return text.strip().replace(", ", ", driver ")


def build():
    if BUILD != Path("build/release"):
        return
    if not TINY:
        subprocess.run(["scripts/bootstrap"], check=True)
    subprocess.run(["scripts/build", "release", "gigastep"], check=True)


# --- Text of tables ---------------------------------------------------------------------------------------------------

def table_line(cells):
    return "| " + " | ".join(cells) + " |"


def table(columns, rows):
    return "\n".join([table_line(columns), "|" + "---|" * len(columns), *map(table_line, rows)])


def short(x):
    """1.23 G, 45.6 M, ...: three digits."""
    for size, unit in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if x >= size:
            return f"{x / size:.3g} {unit}"
    return f"{x:.3g}"


# Two-sided 95 % quantiles of Student's t, by degrees of freedom.
STUDENT = {1: 12.71, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306, 9: 2.262}


def mean_text(values):
    """Mean and 95 % interval over seeds of a share, which lies in [0, 1]."""
    mean = statistics.mean(values)
    if len(values) < 2:
        return f"{mean:.3f}"
    half = STUDENT[min(len(values) - 1, 9)] * statistics.stdev(values) / len(values) ** 0.5
    return f"{mean:.3f} [{max(0, mean - half):.2f}, {min(1, mean + half):.2f}]"


def newest_commit(rows):
    """The rows of the commit that was measured last: a row never mixes two."""
    commit = max(rows, key=lambda row: row["date"])["commit"]
    newest = {row["key"]: row for row in sorted(rows, key=lambda row: row["date"]) if row["commit"] == commit}
    return list(newest.values())


def length_text(group):
    """Agent-steps of the runs, least and most seconds of their commands, and how many ran at once."""
    seconds = [row["seconds"] for row in group]
    span = " to ".join(dict.fromkeys(f"{f(seconds):.0f}" for f in (min, max)))
    beside = max(row["beside"] for row in group)
    return f"{short(group[0]['agent_steps'])}, {span} s" + (f", {beside} at once" if beside > 1 else "")


def seeds_text(group):
    return ", ".join(str(seed) for seed in sorted(row["seed"] for row in group))


def command_text(group):
    """The command of runs that differ in their seed."""
    return "`" + re.sub(r"--seed \d+", "--seed S", group[0]["command"]) + "`"


def stoppable(main):
    """Runs a main program; what it has begun ends where it is stopped."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        return main()
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
