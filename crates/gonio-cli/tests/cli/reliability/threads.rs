//! Answers do not depend on the number of threads.

use super::{Job, job, same, written};

fn compare(job: &Job) {
    let bench = job.bench();
    let mut first = None;
    for threads in [1, 2, 7] {
        let stem = format!("out{threads}");
        bench.run_with(&format!("{} --threads {threads}", job.to(&stem)), &[("GONIO_CACHE_DIR", "")]).succeeds();
        let found = written(&bench, &job.output(&stem));
        same(&found, first.get_or_insert_with(|| found.clone()), &format!("{} with {threads} threads", job.name));
    }
}

#[test]
fn an_answer_is_the_same_on_one_two_and_seven_threads() {
    compare(job("infer"));
}

each_job!(on_one_two_and_seven_threads: compare);
