# Sourced by other scripts.

# show_progress TITLE LOG: until it is killed, shows on the terminal how far a command is whose output goes to LOG, by the
# last "[3/9]" of ninja or "3/9 Test" of ctest in it, and the seconds that it has taken. It ends with the script.
show_progress() {
  local begun=$SECONDS at text columns
  while sleep 1 && kill -0 $$ 2>/dev/null; do
    at=$(tail -c 2000 "$2" 2>/dev/null | grep -oE '^\[[0-9]+/[0-9]+\]|^ *[0-9]+/[0-9]+ Test' | tail -n 1) || true
    at=${at//[^0-9\/]/}
    text="$1 …${at:+ $at} $((SECONDS - begun)) s"
    columns=$(stty size <&2 2>/dev/null | cut -d' ' -f2) || true
    [[ ${columns:-0} -gt 1 ]] || columns=80 # the terminal does not tell
    printf '\r\033[K%s' "${text:0:$((columns - 1))}" >&2
  done
}

# watched TITLE LOG COMMAND...: runs a command and writes its output to LOG; a terminal shows its progress.
watched() {
  local title=$1 log=$2 watcher= status=0
  shift 2
  if [ -t 2 ]; then
    show_progress "$title" "$log" &
    watcher=$!
  fi
  "$@" >"$log" 2>&1 || status=$?
  if [ -n "$watcher" ]; then
    kill "$watcher" 2>/dev/null || true
    wait "$watcher" 2>/dev/null || true
    printf '\r\033[K' >&2
  fi
  return "$status"
}
