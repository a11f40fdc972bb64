options(digits=12, contrasts=c("contr.sum","contr.poly"), warn=-1)
suppressMessages(library(car))
cat("R", R.version.string, "; car", as.character(packageVersion("car")), "\n")
wide <- function(d, v, w1, w2) {
  d$cell <- paste(d[[w1]], d[[w2]], sep=".")
  cells <- unique(d$cell); ids <- unique(d$participant)
  m <- sapply(cells, function(c) d[[v]][d$cell==c][match(ids, d$participant[d$cell==c])])
  g <- factor(d$group[match(ids, d$participant)])
  list(y=m, group=g, cells=cells)
}
show <- function(a) { s <- summary(a, multivariate=FALSE); print(unclass(s$univariate.tests)); print(unclass(s$sphericity.tests)); print(unclass(s$pval.adjustments)) }
cat("== balanced, v1\n")
d <- read.csv("balanced.csv"); w <- wide(d,"v1","confirmation","button")
y <- w$y; g <- w$group
idata <- data.frame(confirmation=factor(rep(c("none","given"),each=3)), button=factor(rep(c("latch","toggle","push"),2)))
m <- lm(y ~ g)
show(Anova(m, idata=idata, idesign=~confirmation*button, type=3))
cat("== unbalanced\n")
d2 <- read.csv("unbalanced.csv"); w2 <- wide(d2,"value","phase","hour"); y2 <- w2$y; g2 <- w2$group
idata2 <- data.frame(phase=factor(rep(paste0("t",1:3),each=4)), hour=factor(rep(paste0("h",1:4),3)))
m2 <- lm(y2 ~ g2)
show(Anova(m2, idata=idata2, idesign=~phase*hour, type=3))
cat("== no between, balanced v2\n")
w3 <- wide(d,"v2","confirmation","button"); y3<-w3$y
show(Anova(lm(y3~1), idata=idata, idesign=~confirmation*button, type=3))
cat("== pairs, unbalanced, phase\n")
M <- sapply(1:3, function(k) rowMeans(y2[, (4*k-3):(4*k)]))
for (ij in list(c(1,2),c(1,3),c(2,3))) { s <- summary(lm(I(M[,ij[1]]-M[,ij[2]]) ~ g2)); print(c(s$coefficients[1,], s$df[2])); print(confint(lm(I(M[,ij[1]]-M[,ij[2]]) ~ g2))[1,]) }
cat("== pairs, no between, button of v2\n")
B <- sapply(1:3, function(k) (y3[,k]+y3[,k+3])/2)
for (ij in list(c(1,2),c(1,3),c(2,3))) { t <- t.test(B[,ij[1]],B[,ij[2]],paired=TRUE); print(c(t$statistic,t$parameter,t$p.value,t$conf.int,t$estimate)) }
cat("== manova, rows independent\n")
Y <- as.matrix(d[,paste0("v",1:7)]); d$confirmation<-factor(d$confirmation); d$button<-factor(d$button)
print(unclass(summary(manova(Y ~ confirmation*button, data=d), test="Pillai")$stats))
cat("== manova, repeated (doubly multivariate), no between\n")
ids <- unique(d$participant)
big <- do.call(cbind, lapply(paste0("v",1:7), function(v) wide(d,v,"confirmation","button")$y))
C1 <- c(1,1,1,-1,-1,-1); D1 <- sapply(0:6, function(k) big[,6*k+1:6] %*% C1)
print(unclass(summary(manova(D1 ~ 1), test="Pillai", intercept=TRUE)$stats))
H <- cbind(c(1,-1,0,1,-1,0), c(1,1,-2,1,1,-2)); D2 <- do.call(cbind, lapply(0:6, function(k) big[,6*k+1:6] %*% H))
print(unclass(summary(manova(D2 ~ 1), test="Pillai", intercept=TRUE)$stats))
cat("== manova, repeated, with group\n")
print(unclass(summary(Anova(lm(D1 ~ g), type=3), test="Pillai")$multivariate.tests$g$SSPH)[1:2,1:2])
print(Anova(lm(D1 ~ g), type=3, test="Pillai"))
cat("== intervals\n"); print(prop.test(27,30,correct=FALSE)$conf.int[1:2]); print(prop.test(0,10,correct=FALSE)$conf.int[1:2])
cat("== ncp\n"); f<-function(q,F,a,b) uniroot(function(l) pf(F,a,b,ncp=l)-q, c(0,500), tol=1e-12)$root
print(c(f(.95,7.46,7,108), f(.05,7.46,7,108))); g2<-function(q,t,d) uniroot(function(l) pt(t,d,ncp=l)-q, c(-30,30), tol=1e-12)$root
print(c(g2(.975,3.1,19), g2(.025,3.1,19)))
