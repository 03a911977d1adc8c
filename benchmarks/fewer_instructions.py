"""`first_to_accuracy.py` as on a processor with fewer instructions, for all: tcbench's code, heyoka's, pydiffsol's.

    python benchmarks/fewer_instructions.py x86-64 scenarios       # SSE2 alone; then what first_to_accuracy.py takes
    python benchmarks/fewer_instructions.py x86-64-v3 stiff 100    # AVX2 and FMA, no AVX-512

TCBENCH_TARGET is for tcbench's own code. heyoka and pydiffsol compile for the processor that they find: here copies of
them find another one. The instruction by which their libraries ask (cpuid) is replaced by one that no processor has,
and a handler of the signal answers with fewer features. SciPy's solvers and SUNDIALS come compiled for SSE2.
Needs x86-64 Linux, a C compiler and objdump.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGES = ("heyoka", "pydiffsol")
LEVELS = {"x86-64": 1, "x86-64-v3": 3}
CPUID, NONE = b"\x0f\xa2", b"\x0f\x0b"  # the instruction that asks, and one (ud2) that there is not
HANDLER = """
#define _GNU_SOURCE
#include <signal.h>
#include <stdint.h>
#include <string.h>
#include <ucontext.h>

static void answer(int signal_, siginfo_t *info, void *context) {
  greg_t *r = ((ucontext_t *)context)->uc_mcontext.gregs;
  uint8_t *ip = (uint8_t *)r[REG_RIP];
  uint32_t leaf = r[REG_RAX], sub = r[REG_RCX], a, b, c, d;
  if (ip[0] != 0x0f || ip[1] != 0x0b) { signal(signal_, SIG_DFL); return; }
  __asm__ volatile("cpuid" : "=a"(a), "=b"(b), "=c"(c), "=d"(d) : "a"(leaf), "c"(sub));
  if (LEVEL == 1) {  /* nothing beyond SSE2 */
    if (leaf == 1) c = 0;
    if (leaf == 7) a = b = c = d = 0;
    if (leaf == 0x80000001) c &= 1;
    if (leaf == 0xd || leaf == 0x14 || leaf == 0x19 || leaf == 0x24) a = b = c = d = 0;
  } else if (leaf == 7 && sub == 0) {  /* no AVX-512 */
    b &= ~0xDC230000u; c &= ~0x5842u; d &= ~0x80010Cu;
  } else if (leaf == 7 && sub == 1) a &= ~0x20u;
  r[REG_RAX] = a; r[REG_RBX] = b; r[REG_RCX] = c; r[REG_RDX] = d; r[REG_RIP] += 2;
}

__attribute__((constructor)) static void begin(void) {
  struct sigaction s; memset(&s, 0, sizeof s);
  s.sa_sigaction = answer; s.sa_flags = SA_SIGINFO | SA_NODEFER; sigaction(SIGILL, &s, 0);
}
"""


def restricted(package: str, folder: Path) -> None:
    """A copy of an installed package in the folder, whose libraries ask by an instruction that there is not."""
    if not (found := importlib.util.find_spec(package)):
        return
    here = Path(found.origin).parent  # type: ignore[arg-type]
    for name in (package, f"{package}.libs"):
        shutil.copytree(here.parent / name, folder / name)
        for library in (folder / name).glob("*.so*"):
            ask_otherwise(library)


def ask_otherwise(library: Path) -> None:
    header = subprocess.run(["readelf", "-SW", library], capture_output=True, text=True, check=True).stdout
    address, offset = (int(x, 16) for x in re.search(r"\.text\s+PROGBITS\s+(\w+)\s+(\w+)", header).groups())  # type: ignore[union-attr]
    code = bytearray(library.read_bytes())
    with subprocess.Popen(["objdump", "-d", "--no-show-raw-insn", library], stdout=subprocess.PIPE, text=True) as dump:
        for line in dump.stdout or ():
            if line.rstrip().endswith("\tcpuid"):
                at = int(line.partition(":")[0], 16) - address + offset
                assert code[at : at + 2] == CPUID
                code[at : at + 2] = NONE
    library.write_bytes(code)


def main(target: str, *rest: str) -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for package in PACKAGES:
            restricted(package, folder)
        source, handler = folder / "handler.c", folder / "handler.so"
        source.write_text(f"#define LEVEL {LEVELS[target]}\n{HANDLER}")
        subprocess.run([os.environ.get("CC", "cc"), "-O1", "-shared", "-fPIC", "-o", handler, source], check=True)
        env = os.environ | {"TCBENCH_TARGET": target, "PYTHONPATH": name, "LD_PRELOAD": str(handler)}
        script = Path(__file__).with_name("first_to_accuracy.py")
        return subprocess.run([sys.executable, script, *rest], env=env, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
