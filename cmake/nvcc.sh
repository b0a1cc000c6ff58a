#!/bin/sh
# nvcc.sh REPORT COMMAND...: runs nvcc and writes what ptxas says of each kernel's registers and spills to REPORT. Any
# other output is a failure, since nvcc may print a warning and still succeed.
report=$1
shift
said=$("$@" -Xptxas -v 2>&1) || { echo "$said"; exit 1; }
about_kernels='^ptxas info|^ +[0-9]+ bytes stack frame'
rest=$(printf '%s\n' "$said" | grep -vE "$about_kernels" | grep .)
[ -z "$rest" ] || { echo "$rest"; exit 1; }
printf '%s\n' "$said" | grep -E "$about_kernels" >"$report"
