"""command line -> a door. `sysid-bench` alone lists the verbs."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Sequence

# One BLAS thread: cells are small and run side by side. Must stand before numpy is first imported.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

POSITIONAL = {"view": "path", "recover": "path"}
DONE, NO, WRONG = 0, 1, 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; the exit code: 0 done, 1 the answer is no, 2 the call or its input is wrong."""
    from sysid_bench.nouns import InputError

    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "debug=true" in arguments
    try:
        return _dispatch([a for a in arguments if not a.startswith("debug=")])
    except InputError as problem:
        if debug:
            raise
        print(f"sysid-bench: {problem}", file=sys.stderr)
        return WRONG
    except KeyboardInterrupt:
        print("sysid-bench: interrupted; what was finished is kept.", file=sys.stderr)
        return NO
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as problem:
        if debug:
            raise
        print(f"sysid-bench: {problem.strerror or problem}: {problem.filename or ''}", file=sys.stderr)
        return WRONG


def _dispatch(arguments: list[str]) -> int:
    from sysid_bench.nouns import InputError

    if not arguments or arguments[0] in ("-h", "--help", "help"):
        from sysid_bench.help import menu

        print(menu())
        return DONE
    if arguments[0] == "--version":
        from sysid_bench import __version__

        print(__version__)
        return DONE
    if arguments[0] in ("--completion", "--complete"):
        from sysid_bench import completion

        found = [completion.BASH] if len(arguments) == 1 else completion.candidates(arguments[1])
        sys.stdout.writelines(f"{text}\n" for text in found)
        return DONE
    verb, rest = arguments[0], arguments[1:]
    from sysid_bench import conf

    known = conf.verbs()
    if verb not in known:
        raise InputError(f"no verb {verb!r}. There are: {', '.join(known)}.")
    if any(a in ("-h", "--help") for a in rest):
        from sysid_bench.help import of_verb

        print(of_verb(verb, rest))
        return DONE
    rest = [_named(verb, word) for word in rest]
    overrides, plugins = conf.split_plugins([a for a in rest if a != "--cfg"])
    cfg = conf.compose(verb, overrides, plugins)
    if "--cfg" in rest:
        import yaml

        print(yaml.safe_dump(cfg, sort_keys=False), end="")
        return DONE
    cfg |= {"plugins": plugins, "words": rest}
    return importlib.import_module(f"sysid_bench.doors.{verb}").main(cfg)


def _named(verb: str, word: str) -> str:
    """A path without its key gets it, where the verb takes one; the path may hold = itself."""
    is_override = re.fullmatch(r"[+~]*[A-Za-z_][\w.]*=.*", word) and not os.path.exists(word)
    if verb not in POSITIONAL or is_override or word.startswith("--"):
        return word
    return f"{POSITIONAL[verb]}={word}"


if __name__ == "__main__":
    sys.exit(main())
