"""An audit in ten lines: every loop of a historian export with its verdict, worst first.

python examples/audit_in_ten_lines.py export/data.parquet export/loops.csv audit
"""

import sys

from monitor import AuditSettings, run_audit

if __name__ == "__main__":  # more jobs start this file again
    export, loops, out = sys.argv[1:]
    result = run_audit([export], loops, out, AuditSettings(jobs=2))
    for row in result.rows:
        print(f"{row.loop:<16} {row.verdict:<13} {row.reason}")
        if row.new_kp is not None:
            print(f"{'':<16} {row.action}")
    print(*result.problems, sep="\n", file=sys.stderr)
    sys.exit(result.exit_code)
