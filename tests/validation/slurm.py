"""A SLURM of one node on this machine, in a folder, with its database; nothing of it stays.

``python tests/validation/slurm.py COMMAND ...`` starts it, runs a command in it, such as ``bash``
or ``bgmodel sweep FILE --on slurm``, and stops it. It needs Debian's packages slurm-wlm, slurmdbd,
munge and mariadb-server, none of their services, and no rights beyond the caller's.
"""

import getpass
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import psutil

PROGRAMS = {
    "munged": "munge",
    "mariadbd": "mariadb-server",
    "mariadb-install-db": "mariadb-server",
    "slurmdbd": "slurmdbd",
    "slurmctld": "slurm-wlm",
    "slurmd": "slurm-wlm",
}
"""Programs that are started, and the package of each."""
PATHS = os.pathsep.join((os.environ["PATH"], "/usr/sbin", "/usr/local/sbin"))
NODE = socket.gethostname().partition(".")[0]
USER = getpass.getuser()
START_S = 120

DATABASE = """
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
DbdHost=localhost
DbdPort={dbd}
SlurmUser={user}
LogFile={folder}/slurmdbd.log
PidFile={folder}/slurmdbd.pid
StorageType=accounting_storage/mysql
StorageHost=127.0.0.1
StoragePort={mariadb}
StorageUser=slurm
StoragePass=slurm
StorageLoc=slurm
"""
"""Settings of the database of jobs, which Snakemake's executor asks through ``sacct``."""
CONTROLLER = """
ClusterName=one
SlurmctldHost={node}(127.0.0.1)
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={ctld}
SlurmdPort={slurmd}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=localhost
AccountingStoragePort={dbd}
AccountingStoragePass={folder}/munge.socket
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
ReturnToService=2
NodeName={node} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=16000
PartitionName=all Nodes={node} Default=YES MaxTime=INFINITE State=UP
"""
"""Settings without control groups, and with as much memory as jobs ask for."""


def missing():
    """Return one sentence that names the packages to install, or None."""
    packages = {p for name, p in PROGRAMS.items() if shutil.which(name, path=PATHS) is None}
    if not packages:
        return None
    return f"a SLURM on this machine needs: apt-get install {' '.join(sorted(packages))}"


def free_ports(count):
    """Return numbers of ports of the loopback address that nothing listens at."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


def write_settings(folder, cpus):
    """Write the settings and the key into a folder; return the port of MariaDB."""
    names = ("mariadb", "dbd", "ctld", "slurmd")
    ports = dict(zip(names, free_ports(len(names)), strict=True))
    values = {"folder": folder, "node": NODE, "user": USER, "cpus": cpus, **ports}
    for name, text in (("slurmdbd.conf", DATABASE), ("slurm.conf", CONTROLLER)):
        (folder / name).write_text(text.format(**values))
        (folder / name).chmod(0o600)
    (folder / "munge.key").write_bytes(os.urandom(128))
    (folder / "munge.key").chmod(0o600)
    (folder / "init.sql").write_text(
        "CREATE DATABASE slurm;\n"  # MariaDB reads a statement per line
        "CREATE USER 'slurm'@'127.0.0.1' IDENTIFIED BY 'slurm';\n"
        "GRANT ALL ON slurm.* TO 'slurm'@'127.0.0.1';\n"
    )
    for name in ("state", "spool"):
        (folder / name).mkdir()
    return ports["mariadb"]


def commands(folder, port):
    """Return the daemons in the order of their start, each with what shows that it is up."""
    munge = [f"--{name}={folder}/munge.{name.partition('-')[0]}" for name in
             ("key-file", "socket", "log-file", "pid-file", "seed-file")]  # fmt: skip
    mariadb = [f"--datadir={folder}/mariadb", f"--socket={folder}/mariadb.socket", f"--port={port}",
               "--bind-address=127.0.0.1", "--skip-name-resolve", f"--user={USER}",
               f"--init-file={folder}/init.sql", "--innodb-buffer-pool-size=64M"]  # fmt: skip
    listens = f"import socket; socket.create_connection(('127.0.0.1', {port}))"
    return [
        (["munged", "-F", *munge], ["munge", "-n", f"--socket={folder}/munge.socket"]),
        (["mariadbd", "--no-defaults", *mariadb], [sys.executable, "-c", listens]),
        (["slurmdbd", "-D"], ["sacctmgr", "-n", "list", "cluster"]),
        (["slurmctld", "-D"], ["scontrol", "ping"]),
        (["slurmd", "-D", "-N", NODE], ["sh", "-c", "sinfo -h -o %T | grep -x idle"]),
    ]  # fmt: skip


@contextmanager
def daemon(command, ready, environment, log):
    """Run a daemon until the block ends; enter the block when a command says that it is ready."""
    with log.open("ab") as output:
        process = subprocess.Popen(
            command, env=environment, stdout=output, stderr=output, start_new_session=True
        )
    try:
        wait_until(ready, environment, process, log)
        yield process
    finally:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def wait_until(ready, environment, process, log):
    """Run a command until it succeeds; RuntimeError if the daemon ends, or is not ready in time."""
    end = time.monotonic() + START_S
    while subprocess.run(ready, env=environment, capture_output=True, check=False).returncode:
        if process.poll() is not None or time.monotonic() > end:
            raise RuntimeError(f"{process.args[0]} did not start:\n{log.read_text()[-2000:]}")
        time.sleep(0.2)


def stop_jobs(environment):
    """Cancel every job, wait for their ends, and kill what is left of them."""
    subprocess.run(["scancel", "--user", USER], env=environment, check=False)
    end = time.monotonic() + 30
    while time.monotonic() < end:
        queue = subprocess.run(["squeue", "-h"], env=environment, capture_output=True, check=False)
        if not queue.stdout.strip():
            break
        time.sleep(0.5)
    for process in left_over(environment["SLURM_CONF"]):
        process.kill()


def left_over(settings):
    """Return the processes of jobs of the SLURM with these settings."""
    processes = []
    for process in psutil.process_iter():
        try:
            inside = process.environ()
        except psutil.Error:
            continue
        if inside.get("SLURM_CONF") == settings and "SLURM_JOB_ID" in inside:
            processes.append(process)
    return processes


@contextmanager
def one_node(cpus=2):
    """Start SLURM in a temporary folder, and stop it with all its jobs; yield the environment."""
    if sentence := missing():
        raise RuntimeError(sentence)
    with TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        folder.chmod(0o755)  # munged refuses a folder that others cannot enter
        port = write_settings(folder, cpus)
        settings = {"PATH": PATHS, "USER": USER, "SLURM_CONF": f"{name}/slurm.conf"}
        environment = {**os.environ, **settings}
        database = ["--no-defaults", f"--datadir={folder}/mariadb", f"--user={USER}",
                    "--skip-test-db", "--auth-root-authentication-method=normal"]  # fmt: skip
        made = ["mariadb-install-db", *database]
        subprocess.run(made, env=environment, check=True, capture_output=True)
        for command, ready in commands(folder, port):
            log = folder / f"{command[0]}.out"
            stack.enter_context(daemon(command, ready, environment, log))
        stack.callback(stop_jobs, environment)
        yield environment


def main():
    """Run the command of the arguments in a SLURM; return its exit status."""
    if not sys.argv[1:]:
        sys.exit(f"usage: {sys.argv[0]} COMMAND ...")
    if sentence := missing():
        sys.exit(sentence)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that what was started is stopped
    with one_node() as environment:
        return subprocess.run(sys.argv[1:], env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
