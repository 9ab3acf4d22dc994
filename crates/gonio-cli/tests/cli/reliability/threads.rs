//! Answers do not depend on the number of threads.

use super::{Job, job, same, written};

fn compare(job: &Job) {
    let bench = job.bench();
    // On two threads it was run undisturbed.
    let whole = &job.undisturbed().files;
    for threads in [1, 7] {
        bench.run_with(&format!("{} --threads {threads}", job.to("out")), &[("GONIO_CACHE_DIR", "")]).succeeds();
        same(&written(&bench, &job.output("out")), whole, &format!("{} with {threads} threads", job.name));
    }
}

#[test]
fn an_answer_is_the_same_on_one_two_and_seven_threads() {
    compare(job("infer"));
}

each_job!(on_one_two_and_seven_threads: compare);
