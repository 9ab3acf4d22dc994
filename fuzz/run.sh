#!/usr/bin/env bash
# Runs fuzz targets in parallel, each for a number of inputs or seconds, whichever ends first.
#
#   fuzz/run.sh BINARIES SEEDS OUT [SECONDS [RUNS [PROCESSES]]]
#
# BINARIES contains one program per target, SEEDS one folder of seeds per target (fuzz/seeds). OUT
# receives a log, the corpus and the findings of each target, and summary.txt: executions, covered
# edges, kept inputs, findings, seconds. After a finding, a target continues with another random seed
# until its runs or seconds are used up.
set -u
[ $# -ge 3 ] || { sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 2; }
binaries=$(realpath "$1") seeds=$(realpath "$2") out=$3
seconds=${4:-300} runs=${5:-1000000} processes=${6:-$(nproc)}
mkdir -p "$out"; out=$(realpath "$out")

# Slow targets start first, split among several processes, so that none runs alone at the end.
order="results results results results picture picture normals normals mesh_gltf mesh_ply"
# Otherwise, decoders would start threads for each input.
export RAYON_NUM_THREADS=1

one() {
    local target=$1 part=$2 runs=$((runs / $3)) end=$(($(date +%s) + seconds)) begin left done=0 round=0 now
    local name=$target.$part
    local log=$out/$name.log found=$out/$name.findings corpus=$out/corpus/$name
    begin=$(date +%s); mkdir -p "$found" "$corpus"; : >"$log"
    while [ "$done" -lt "$runs" ] && now=$(date +%s) && [ "$now" -lt "$end" ] && [ "$round" -lt 50 ]; do
        left=$((runs - done)); round=$((round + 1))
        "$binaries/$target" "$corpus" "$seeds/$target" -runs="$left" -max_total_time=$((end - now)) -seed=$((100 * part + round)) \
            -rss_limit_mb=2048 -malloc_limit_mb=1024 -timeout=10 -max_len=6000 -len_control=20 -print_final_stats=1 \
            -artifact_prefix="$found/" >"$out/$name.part" 2>&1
        # A crashed run prints no statistics; its last line contains the number of inputs.
        local made
        made=$(sed -n 's/^stat::number_of_executed_units: *//p' "$out/$name.part" | tail -1)
        [ -n "$made" ] || made=$(grep -aoE '^#[0-9]+' "$out/$name.part" | tail -1 | tr -d '#')
        done=$((done + ${made:-1}))
        cat "$out/$name.part" >>"$log"; rm "$out/$name.part"
    done
    local edges features findings
    edges=$(grep -aoE 'cov: [0-9]+' "$log" | awk '{ if ($2 > m) m = $2 } END { print m + 0 }')
    features=$(grep -aoE 'ft: [0-9]+' "$log" | awk '{ if ($2 > m) m = $2 } END { print m + 0 }')
    findings=$(find "$found" -type f | wc -l)
    printf '%-12s %9d %7d %8d %7d %8d %7d\n' "$name" "$done" "$edges" "$features" \
        "$(find "$corpus" -type f | wc -l)" "$findings" $(($(date +%s) - begin)) >"$out/$name.summary"
}

parts() { grep -ow "$1" <<<"$order" | wc -l; }
targets=$order
for target in $(cd "$binaries" && ls); do
    [ -x "$binaries/$target" ] && [ "$(parts "$target")" = 0 ] && targets="$targets $target"
done
declare -A begun
for target in $targets; do
    [ -x "$binaries/$target" ] || continue
    while [ "$(jobs -rp | wc -l)" -ge "$processes" ]; do wait -n; done
    begun[$target]=$((${begun[$target]:-0} + 1))
    all=$(parts "$target")
    one "$target" "${begun[$target]}" $((all > 0 ? all : 1)) &
done
wait
{
    printf '%-12s %9s %7s %8s %7s %8s %7s\n' target inputs edges features corpus findings seconds
    cat "$out"/*.summary
    awk '{ n += $2; f += $6 } END { printf "%-12s %9d %33d\n", "all", n, f }' "$out"/*.summary
} >"$out/summary.txt"
rm -f "$out"/*.summary
cat "$out/summary.txt"
