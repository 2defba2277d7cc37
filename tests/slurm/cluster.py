"""A cluster of Slurm with one node, this machine, in a directory of its own: daemons, sockets and ports of its own.

Needs root, and Debian's packages of docker/packages-slurm.txt.
"""
import os
import pathlib
import shutil
import socket
import subprocess
import time

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel")
PATIENCE = 60  # seconds, for a daemon to answer


def why_not():
    """Why there can be no cluster here; empty if there can."""
    missing = [program for program in PROGRAMS if shutil.which(program, path=os.environ["PATH"] + ":/usr/sbin") is None]
    if missing:
        return f"Slurm is not installed ({', '.join(missing)}): docker/packages-slurm.txt"
    return "" if os.geteuid() == 0 else "Slurm's daemons need root"


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Cluster:
    """Runs from its creation to the end of the `with` block. `cpus` may be more than the machine has."""

    def __init__(self, directory, cpus):
        self.directory = pathlib.Path(directory)
        self.daemons = []
        self.environment = {**os.environ, "SLURM_CONF": str(self.directory / "slurm.conf")}
        self.environment["PATH"] = os.environ["PATH"] + ":/usr/sbin"
        for name in ("state", "spool", "munge"):
            (self.directory / name).mkdir(mode=0o755, parents=True)
        self._write_files(cpus)

    def __enter__(self):
        munge = self.directory / "munge"
        files = {"key-file": "key", "socket": "socket", "pid-file": "pid", "log-file": "log", "seed-file": "seed"}
        try:
            options = [f"--{option}={munge}/{name}" for option, name in files.items()]
            self._start("munged", "--foreground", "--force", *options)
            self._wait("munged", lambda: (munge / "socket").exists())
            self._start("slurmctld", "-D", "-i")
            self._start("slurmd", "-D", "-N", socket.gethostname().split(".")[0])
            self._wait("slurmd", lambda: "idle" in self.run("sinfo", "--noheader", "-o", "%t", check=False))
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                daemon.kill()
        self.daemons = []

    def run(self, *command, check=True, **more):
        """What a command prints. `more`: variables of its environment."""
        done = subprocess.run(
            command,
            env={**self.environment, **more},
            cwd=self.directory,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=PATIENCE,
        )
        if check and done.returncode != 0:
            raise RuntimeError(f"{' '.join(map(str, command))}: exit {done.returncode}\n{done.stdout}")
        return done.stdout

    def jobs(self):
        """State by job, {"12_3": "RUNNING"}, of jobs that ended within some minutes too."""
        states = {}
        for line in self.run("scontrol", "show", "job", "--oneliner").splitlines():
            fields = dict(field.split("=", 1) for field in line.split() if "=" in field)
            if "JobId" not in fields:
                continue
            task = fields.get("ArrayTaskId", "")
            name = f"{fields['ArrayJobId']}_{task}" if task else fields["JobId"]
            states[name] = fields["JobState"]
        return states

    def processes(self, job, program):
        """Numbers of the processes of a running job, given as it is in squeue's %A, that run this program."""
        found = []
        for directory in pathlib.Path("/proc").iterdir():
            try:
                if not directory.name.isdigit() or (directory / "comm").read_text().strip() != program:
                    continue
                variables = (directory / "environ").read_bytes().split(b"\0")
            except OSError:
                continue  # it has ended
            if f"SLURM_CONF={self.directory / 'slurm.conf'}".encode() in variables and (
                f"SLURM_JOB_ID={job}".encode() in variables
            ):
                found.append(int(directory.name))
        return found

    def _start(self, *command):
        log = open(self.directory / f"{command[0]}.out", "wb")  # for the daemon; the test reads it if it fails
        self.daemons.append(subprocess.Popen(command, env=self.environment, stdout=log, stderr=log))
        log.close()

    def _wait(self, name, is_there):
        end = time.monotonic() + PATIENCE
        while not is_there():
            dead = next((daemon for daemon in self.daemons if daemon.poll() is not None), None)
            if dead is not None or time.monotonic() > end:
                logs = "".join(path.read_text(errors="replace")[-2000:] for path in self.directory.glob("*.out"))
                raise RuntimeError(f"{name} does not answer\n{logs}")
            time.sleep(0.1)

    def _write_files(self, cpus):
        host = socket.gethostname().split(".")[0]
        key = self.directory / "munge/key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        (self.directory / "gres.conf").write_text("Name=gpu File=/dev/null\n")
        settings = {
            "ClusterName": "voxelpipe",
            "SlurmctldHost": f"{host}(127.0.0.1)",
            "SlurmctldPort": free_port(),
            "SlurmdPort": free_port(),
            "SlurmUser": "root",
            "SlurmdUser": "root",
            "AuthType": "auth/munge",
            "AuthInfo": f"socket={self.directory}/munge/socket",
            "CredType": "cred/munge",
            "StateSaveLocation": self.directory / "state",
            "SlurmdSpoolDir": self.directory / "spool",
            "SlurmctldPidFile": self.directory / "slurmctld.pid",
            "SlurmdPidFile": self.directory / "slurmd.pid",
            "ProctrackType": "proctrack/linuxproc",
            "TaskPlugin": "task/none",
            "JobAcctGatherType": "jobacct_gather/none",
            "AccountingStorageType": "accounting_storage/none",
            "MpiDefault": "none",
            "SelectType": "select/cons_tres",
            "SelectTypeParameters": "CR_CPU",
            "SlurmdParameters": "config_overrides",
            "ReturnToService": 2,
            "KillWait": 5,
            "MinJobAge": 3600,
            "GresTypes": "gpu",
        }
        lines = [f"{key}={value}" for key, value in settings.items()]
        lines.append(f"NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} Gres=gpu:1 State=UNKNOWN")
        lines.append(f"PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP")
        (self.directory / "slurm.conf").write_text("\n".join(lines) + "\n")
